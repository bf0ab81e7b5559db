//! Animation on the GPU: kernels sample clips, plan and update; the CPU always records the same steps.
//!
//! `sample`: time, keys and interpolation. `clips`: uploaded data. `playback`: what each instance plays.
//! `steps` and `layout`: an update as data, and buffer layouts. `technique`:
//! the device side.

mod clips;
mod layout;
mod playback;
#[cfg(test)]
#[path = "../../../tests/common/twin.rs"]
mod reference;
mod sample;
mod steps;
#[allow(unsafe_code)]
mod technique;

pub use clips::{AnimationDesc, Clips, KeyFormat};
pub use sample::Playback;
#[cfg(test)]
pub(crate) use steps::UPLOADED;
pub use technique::Animated;
pub use {
    playback::Playbacks,
    sample::PlaybackRecord,
    steps::{AnimatedKernel, AnimatedUpdate},
};

#[cfg(test)]
mod tests;
