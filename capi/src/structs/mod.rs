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
    ($($name:ident $($first:literal)? $($reserved:ident)?;)*) => {$(
        // SAFETY: `repr(C)` without padding (header.rs adds up the sizes of fields), a `u32` first, and numbers,
        // pointers and nullable functions after it.
        unsafe impl Versioned for $name {
            const NAME: &'static str = stringify!($name);
            $(const FIRST_SIZE: usize = $first;)?
            $(fn reserved(&self) -> u32 {
                self.$reserved
            })?
        }
    )*};
}

// A structure that gets fields after a release states its size in the first version: `DmCrowdDesc 96 reserved;`.
versioned! {
    DmEngineDesc reserved;
    DmEngineInfo;
    DmMeshDesc;
    DmMeshArrays;
    DmTargetArrays;
    DmSampleDesc;
    DmMeshInfo;
    DmRenderVertices;
    DmCrowdDesc reserved;
    DmAnimationDesc reserved;
    DmLevelDesc;
    DmPlayback reserved;
    DmUpdate;
    DmPoseView;
    DmStreamView;
    DmSkinDesc reserved;
    DmOutputTarget;
    DmOutputView;
    DmClipInfo;
    DmClipArrays;
}
