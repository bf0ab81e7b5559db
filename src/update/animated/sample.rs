//! Clips on the grid of exact sums, and what a head shows of them at a time: in integers, so that GPU and CPU agree bit
//! for bit.
//!
//! # Keys
//! A weight of a clip is kept as a whole number of steps of the mesh's
//! [`ExactGrid`](crate::pack::blocks::ExactGrid): 32 bits, or 16 bits of the number
//! shifted to the right ([`KeyFormat`]). [`Clips`] has the layout.
//!
//! # Time
//! The host's clock is told in seconds and kept in ticks of 2⁻¹⁶ s. A head's [`HeadRecord`] has the low 32 bits of the
//! tick at which it started, its rate in 2⁻¹⁶ frames a second, and the place in the clip where it started:
//!
//! ```text
//! elapsed  = max(now − start, 0)                      as a signed 32-bit number
//! position = frame · 2³² + fraction + elapsed · rate  64 bits: whole frames, and the fraction of a frame
//! ```
//!
//! A tick times a rate is 2⁻³² frames, so the product needs no scaling. Looping clips take whole frames modulo their
//! number, and the frame after the last is the first; others hold their last frame. A clip played backwards counts its
//! frames from the end. [`Playbacks`](super::Playbacks) starts records anew, exactly where they are, long before
//! `elapsed` runs out of bits.
//!
//! # Weights
//! With k₀ and k₁ the keys of this frame and the next, and f the upper 16 bits of the fraction,
//!
//! ```text
//! weight = k₀ + ⌊((k₁ − k₀) · f + 2¹⁵) / 2¹⁶⌋          in steps
//! ```
//!
//! which [`sample`] and `glsl/animate.comp` compute alike.

#[cfg(any(test, feature = "internals"))]
use super::clips::Clips;
use crate::abi::numbers;
use crate::setters::setters;
use bytemuck::{Pod, Zeroable};

/// Ticks of the clock in a second.
pub const TICKS_PER_SECOND: f64 = 65_536.0;

/// What happens when a clip ends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Repeat {
    /// It starts again: from its last frame to its first as from any frame to the next.
    #[default]
    Loop,
    /// Its last frame stays.
    Once,
}

/// How a head plays a clip.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Playback {
    /// Which clip.
    pub clip: u32,
    /// When it starts, in seconds of the clock that [`Playbacks::set_time`](super::Playbacks::set_time) tells. Before,
    /// the first frame is shown.
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

/// What a head plays, as `glsl/animate.comp` reads it.
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
    /// Padding to 32 bytes.
    pub unused: [u32; 2],
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

    /// Whether a flag is set.
    pub const fn has(&self, flag: u32) -> bool {
        self.flags & flag != 0
    }

    /// Where the clip is at `now`, in steps of 2⁻³² frames; looping clips are not wrapped yet.
    #[cfg(any(test, feature = "internals"))]
    pub fn position(&self, now: u32) -> u64 {
        let elapsed = (now.wrapping_sub(self.start) as i32).max(0) as u64;
        (u64::from(self.frame) << 32 | u64::from(self.fraction)) + elapsed * u64::from(self.rate)
    }
}

/// Between which frames a clip of `frames` is at `position`, and how far: `(frame, next, f)` with f in 2⁻¹⁶.
#[cfg(any(test, feature = "internals"))]
pub fn between(record: &HeadRecord, frames: u32, position: u64) -> (u32, u32, u32) {
    let (whole, fraction) = ((position >> 32) as u32, (position >> 16) as u32 & 0xffff);
    let last = frames - 1;
    let (frame, next, f) = if record.has(HeadRecord::LOOP) {
        let frame = whole % frames;
        (frame, if frame == last { 0 } else { frame + 1 }, fraction)
    } else if whole >= last {
        (last, last, 0)
    } else {
        (whole, whole + 1, fraction)
    };
    if record.has(HeadRecord::REVERSED) { (last - frame, last - next, f) } else { (frame, next, f) }
}

/// From `k0` to `k1`, `f`·2⁻¹⁶ of the way, to nearest.
#[cfg(any(test, feature = "internals"))]
pub fn interpolate(k0: i32, k1: i32, f: u32) -> i32 {
    let product = i64::from(k1 - k0) * i64::from(f);
    k0 + ((product + 0x8000) >> 16) as i32
}

/// The weights, in steps of the grid, that a head shows at tick `now`. The twin of `glsl/animate.comp`.
///
/// # Panics
/// When `out` is not a place for each target.
#[cfg(any(test, feature = "internals"))]
pub fn sample(clips: &Clips, record: &HeadRecord, now: u32, out: &mut [i32]) {
    assert_eq!(out.len(), clips.targets());
    if !record.has(HeadRecord::PLAYING) {
        out.fill(0);
        return;
    }
    let clip = record.clip as usize;
    let (frame, next, f) = between(record, clips.frames(clip), record.position(now));
    for (target, out) in out.iter_mut().enumerate() {
        *out = interpolate(clips.key(clip, frame, target), clips.key(clip, next, target), f);
    }
}
