//! Animation on the GPU: clips are sampled, planned and applied there, and the CPU records the same steps whatever
//! moves.
//!
//! `sample` has time, keys and interpolation, `clips` what is uploaded once and which changes an error budget defers,
//! `playback` what each instance plays, `level` how many targets it keeps; `reference` does on the CPU what the kernels
//! do. `steps` and `layout` are an update as data and where everything lies, `technique` carries it out.

mod clips;
mod layout;
mod level;
mod playback;
mod read;
mod reference;
mod sample;
mod steps;
#[allow(unsafe_code)]
mod technique;

pub use clips::{AnimationDesc, Clips, KeyFormat};
pub use read::PlannedGroup;
pub use sample::Playback;
#[cfg(test)]
pub(crate) use steps::UPLOADED;
pub(crate) use technique::Animated;
pub use {clips::Budget, playback::Playbacks, reference::AnimatedReference, sample::HeadRecord, steps::AnimatedUpdate};

#[cfg(test)]
mod tests;
