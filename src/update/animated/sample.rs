//! What an instance shows of a clip at a time: in integers, so that GPU and CPU agree bit for bit.
//!
//! The clock is kept in ticks of 2⁻¹⁶ s. An instance's [`HeadRecord`] has the low 32 bits of the tick at which it
//! started, its rate in 2⁻¹⁶ frames a second, and the position in the clip where it started:
//!
//! ```text
//! elapsed  = max(now − start, 0)                      as a signed 32-bit number
//! position = frame · 2³² + fraction + elapsed · rate  64 bits: whole frames, and the fraction of a frame
//! ```
//!
//! Looping clips take whole frames modulo their number, and the frame after the last is the first; others hold their
//! last frame. A clip played backwards counts its frames from the end. [`Playbacks`](super::Playbacks) starts records
//! anew, exactly where they are, long before `elapsed` runs out of bits. With k₀ and k₁ the keys of this frame and the
//! next, in steps of the mesh's [`PoseGrid`](crate::pack::blocks::PoseGrid), and f the upper 16 bits of the fraction,
//!
//! ```text
//! weight = k₀ + ⌊((k₁ − k₀) · f + 2¹⁵) / 2¹⁶⌋          in steps
//! ```
//!
//! With a level of detail N, in steps of 2⁻¹⁶ targets, the weight of the target of rank r is interpolated once more,
//! from 0 to what it is, with f = clamp(N − r · 2¹⁶, 0, 2¹⁶). N is what the host says, or less where the level follows
//! the camera.

use crate::abi::numbers;
use crate::setters::setters;
use crate::weights::Repeat;
use bytemuck::{Pod, Zeroable};

/// Ticks of the clock in a second.
pub const TICKS_PER_SECOND: f64 = 65_536.0;

/// How an instance plays a clip.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Playback {
    /// Which clip.
    pub clip: u32,
    /// When it starts, in seconds of the clock that [`AnimatedCrowd::set_time`](crate::AnimatedCrowd::set_time) sets.
    /// Before, the first frame is shown.
    pub start: f64,
    /// 1 is the clip's own speed; backwards below 0.
    pub speed: f64,
    /// What happens when it ends.
    pub repeat: Repeat,
}

setters!(Playback { clip: u32, start: f64, speed: f64, repeat: Repeat });

impl Playback {
    /// `clip` from the clock's second 0 on, at its own speed, over and over.
    pub const fn new(clip: u32) -> Self {
        Self { clip, start: 0.0, speed: 1.0, repeat: Repeat::Loop }
    }
}

/// What an instance plays and where it is, as `glsl/animate.comp` and `glsl/level.comp` read it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct HeadRecord {
    /// The clip.
    pub clip: u32,
    /// Low bits of the tick at which it is at `frame` and `fraction`.
    pub start: u32,
    /// Frames a second, in steps of 2⁻¹⁶.
    pub rate: u32,
    /// Bits of [`HeadRecord::PLAYING`] and so on.
    pub flags: u32,
    /// Whole frames at `start`.
    pub frame: u32,
    /// Fraction of a frame at `start`, in steps of 2⁻³².
    pub fraction: u32,
    /// Targets kept, in steps of 2⁻¹⁶, where `ranks_at` is not 0. With a level of detail that follows the camera the
    /// device overwrites it in each update.
    pub level: u32,
    /// Where the ranks of targets are in the tables; 0: all targets are kept.
    pub ranks_at: u32,
    /// Where it is, for a level of detail that follows the camera: bits of the middle of a ball, its radius, and world
    /// units of an input unit.
    pub place: [u32; 5],
    /// Grows where the next pose has no predecessor.
    pub epoch: u32,
    /// What the host allows of `level`.
    pub most: u32,
    /// 0. Records of 64 bytes begin at a shift.
    pub padding: u32,
}

impl HeadRecord {
    /// A clip is played; without, all weights are 0.
    pub const PLAYING: u32 = numbers::PLAYING;
    /// It loops.
    pub const LOOP: u32 = numbers::LOOP;
    /// Backwards.
    pub const REVERSED: u32 = numbers::REVERSED;
    /// Nothing is updated.
    pub const HIDDEN: u32 = numbers::HIDDEN;
    /// No more targets are kept than its size on the screen needs.
    pub const FOLLOWS: u32 = numbers::FOLLOWS;

    /// Whether a flag is set.
    pub const fn has(&self, flag: u32) -> bool {
        self.flags & flag != 0
    }
}
