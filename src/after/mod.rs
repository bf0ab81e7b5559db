//! Post-morph passes: they read the poses that an update wrote, and write buffers of the application, for each instance
//! that has a target.
//!
//! - [`MorphEngine::set_output_target`](crate::MorphEngine::set_output_target): streams of a pose in vertices of the
//!   application, in its formats and order; skinned by joints or not, with linear blending or dual quaternions.
//! - [`MorphEngine::set_normals_target`](crate::MorphEngine::set_normals_target): normals of the morphed surface,
//!   instead of morphed ones.
//!
//! A pass is recorded with the update, after its own steps. It writes the blocks that the update changed (dense paths
//! and animated crowds: all of a pose that changed, or may have), or nothing if nothing changed. It writes everything
//! the first time, after the instance was hidden, and after an update that wrote the target was discarded. Its output
//! is ready for the [consumers](crate::CrowdDesc::consumers) of the crowd, and waits for their reads, like poses. An
//! instance has at most one target of each kind; removing the instance removes its targets.

#[allow(unsafe_code)]
mod attached;
mod context;
mod normals;
mod output;
#[allow(unsafe_code)]
mod pass;
mod pieces;
mod skin;
mod steps;

pub(crate) use context::TargetContext;
pub use normals::GpuNormals;
#[doc(hidden)]
pub use normals::normals;
pub use output::{OutputStream, OutputTarget, OutputView};
#[doc(hidden)]
pub use skin::skin;
pub use skin::{GpuSkin, Joints, SkinDesc, SkinMethod};
pub(crate) use steps::After;
