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

// With the size in the first version, if fields were added since.
versioned! {
    DmEngineDesc 72;
    DmEngineInfo;
    DmMemory;
    DmMeshDesc 48;
    DmMeshArrays;
    DmTargetArrays;
    DmSampleDesc;
    DmMeshInfo;
    DmRenderVertices;
    DmCrowdDesc 48;
    DmHostPoses;
    DmAnimationDesc 24;
    DmLevelDesc;
    DmPlayback;
    DmUpdate 80;
    DmPoseView;
    DmStreamView;
    DmDecodeTarget;
    DmNormalsTarget;
    DmSkinDesc;
    DmSkinTarget;
    DmSkinnedView;
    DmClipInfo;
    DmClipArrays;
    DmClipLayer;
}
