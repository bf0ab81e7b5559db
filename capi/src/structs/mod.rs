//! The structures that cross the boundary. Fields are ordered so that there is no padding.

mod after;
mod crowd;
mod device;
mod mesh;

pub use after::*;
pub use crowd::*;
pub use device::*;
pub use mesh::*;

use crate::memory::Versioned;

macro_rules! versioned {
    ($($name:ident $($first:literal)?;)*) => {$(
        // SAFETY: `repr(C)` without padding (header.rs adds up the sizes of fields), a `u32` first, and numbers,
        // pointers and nullable functions after it.
        unsafe impl Versioned for $name {
            const NAME: &'static str = stringify!($name);
            $(const FIRST_SIZE: usize = $first;)?
        }
    )*};
}

// A structure that gets fields after a release states its size in the first version: `DmCrowdDesc 96;`.
versioned! {
    DmEngineDesc;
    DmEngineInfo;
    DmMeshDesc;
    DmMeshArrays;
    DmTargetArrays;
    DmSampleDesc;
    DmMeshInfo;
    DmRenderVertices;
    DmCrowdDesc;
    DmHostPoses;
    DmAnimationDesc;
    DmLevelDesc;
    DmPlayback;
    DmUpdate;
    DmPoseView;
    DmStreamView;
    DmNormalsTarget;
    DmSkinDesc;
    DmOutputTarget;
    DmOutputView;
    DmClipInfo;
    DmClipArrays;
}
