//! Sampling of clips, in integers, so that GPU and CPU agree bit for bit.
//!
//! The clock counts ticks of 2⁻¹⁶ s. An instance's [`PlaybackRecord`] holds the low 32 bits of its start tick, its rate
//! in 2⁻¹⁶ frames per second, and the position in the clip at the start:
//!
//! ```text
//! elapsed  = max(now − start, 0)                      as a signed 32-bit number
//! position = frame · 2³² + fraction + elapsed · rate  64 bits: whole frames, and the fraction of a frame
//! ```
//!
//! Looping clips take whole frames modulo their number, and the last frame is followed by the first; others hold their
//! last frame. A clip played backwards counts frames from the end. [`Playbacks`](super::Playbacks) rebases records, at
//! exactly their position, long before `elapsed` overflows. With keys k₀ and k₁ of this frame and the next, in steps of
//! the mesh's [`PoseGrid`](crate::pack::blocks::PoseGrid), and the upper 16 bits f of the fraction,
//!
//! ```text
//! weight = k₀ + ⌊((k₁ − k₀) · f + 2¹⁵) / 2¹⁶⌋          in steps
//! ```
//!
//! With a level of detail of N targets, in 2⁻¹⁶, the weight of the target of rank r is scaled once more, interpolated
//! from 0 with f = clamp(N − r · 2¹⁶, 0, 2¹⁶).

use crate::weights::Repeat;
use bytemuck::{Pod, Zeroable};

/// Clock ticks per second.
pub const TICKS_PER_SECOND: f64 = 65_536.0;

/// How an instance plays a clip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Playback {
    /// Index of the clip.
    pub clip: u32,
    /// Start time in seconds, on the clock of [`Crowd::set_time`](crate::Crowd::set_time). The first
    /// frame is shown before it.
    pub start: f64,
    /// Playback speed; 1 is the clip's own, negative plays backwards.
    pub speed: f64,
    /// Behaviour at the end of the clip.
    pub repeat: Repeat,
}

impl Playback {
    /// Loops `clip` from time 0 on, at its own speed.
    pub const fn new(clip: u32) -> Self {
        Self { clip, start: 0.0, speed: 1.0, repeat: Repeat::Loop }
    }
}

/// Playback state of an instance, in the layout of `glsl/animate.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct PlaybackRecord {
    /// Index of the clip.
    pub clip: u32,
    /// Low bits of the tick at which it is at `frame` and `fraction`.
    pub start: u32,
    /// Frames per second, in 2⁻¹⁶.
    pub rate: u32,
    /// [`PLAYING`](crate::abi::numbers::PLAYING) and what follows it there.
    pub flags: u32,
    /// Whole frames at `start`.
    pub frame: u32,
    /// Fraction of a frame at `start`, in 2⁻³².
    pub fraction: u32,
    /// Targets kept, in 2⁻¹⁶, if `ranks_at` is not 0.
    pub level: u32,
    /// First word of the ranks in the tables; 0: all targets are kept.
    pub ranks_at: u32,
}

impl PlaybackRecord {
    /// Whether a flag is set.
    pub const fn has(&self, flag: u32) -> bool {
        self.flags & flag != 0
    }
}
