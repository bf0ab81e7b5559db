//! The structures that cross the boundary. Fields are ordered so that there is no padding.

mod crowd;
mod device;
mod mesh;

pub use crowd::*;
pub use device::*;
pub use mesh::*;

use crate::memory::Versioned;

macro_rules! versioned {
    ($($name:ident)*) => {$(
        // SAFETY: `repr(C)` without padding (header.rs adds up the sizes of fields), a `u32` first, and numbers,
        // pointers and nullable functions after it.
        unsafe impl Versioned for $name {
            const NAME: &'static str = stringify!($name);
        }
    )*};
}

versioned! {
    DmEngineDesc DmEngineInfo DmMeshDesc DmMeshArrays DmTargetArrays DmSampleDesc DmMeshInfo DmRenderVertices
    DmCrowdDesc DmAnimationDesc DmPlayback DmUpdate DmPoseView DmStreamView DmDecodeTarget DmClipInfo DmClipArrays
}
