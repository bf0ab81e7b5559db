//! What most files of the test program use.

pub use crate::buffers::{Buffers, Shared};
pub use crate::gpu::{NORMAL, drivers, is_kept, on_device, on_every_device, update_descs};
pub use crate::hazards::{Event, HazardChecker};
pub(crate) use crate::{data, gpu, testing};
pub use deltamorph::after::{GpuNormals, GpuSkin, Joints, OutputStream, OutputTarget, SkinDesc, SkinMethod};
pub use deltamorph::ash::vk;
pub use deltamorph::internals::gpu::tuning::DeviceTuning;
pub use deltamorph::internals::plan::schedule::{Barrier, Entry, asset_uploaded};
pub use deltamorph::packed::PoseGrid;
pub use deltamorph::reference::{compare, evaluate};
pub use deltamorph::{
    AnimationDesc, BatchSize, BlockDesc, Clips, Consumers, CpuCrowd, Crowd, CrowdDesc, DeltaFormat, DeviceCaps,
    DeviceDesc, Error, GpuMesh, KeptMesh, Mesh, MorphEngine, POSE_FLOATS, PackDesc, PackedMesh, Playback, PoseFormat,
    Semantic, Tolerance, UpdateDesc, UpdateMode, UpdatePath, WeightClip, ash, reference,
};
pub use deltamorph_head::{HeadDesc, Rng, head, head_clip};
pub use deltamorph_headless::{DeviceChoice, Draws, Headless, HeadlessCrowd, HeadlessDesc};
pub use std::collections::HashMap;
pub use std::sync::Arc;
