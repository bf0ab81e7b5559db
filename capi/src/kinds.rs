//! The one list of the kinds of objects that handles name.

use crate::handles::*;
use deltamorph::after::{GpuNormals, GpuSkin};

/// The list of handles: the type of each object, and its name in messages. The number of a kind is its position in the
/// list.
macro_rules! kinds {
    ($($handle:ident $object:ty, $what:literal;)*) => {
        /// The name of each kind, by number.
        pub const KINDS: &[&str] = &["", $($what),*];

        enum Kind {
            _None,
            $($handle,)*
        }

        $(impl Handle for $handle {
            type Object = $object;

            fn registry() -> &'static Registry<$object> {
                static REGISTRY: Registry<$object> = Registry::new(Kind::$handle as u8);
                &REGISTRY
            }

            fn of(bits: u64) -> Self {
                Self { bits }
            }

            fn bits(self) -> u64 {
                self.bits
            }
        })*
    };
}

kinds! {
    DmMesh crate::mesh::Mesh, "a mesh";
    DmEngine crate::engine::Engine, "an engine";
    DmGpuMesh crate::upload::GpuMesh, "a mesh on the device";
    DmCrowd crate::crowd::Crowd, "a crowd";
    DmClip crate::clip::Clip, "a clip";
    DmBoundClip crate::clip::BoundClip, "a bound clip";
    DmReadback crate::readback::Readback, "a read-back";
    DmSkin crate::attached::Attached<GpuSkin>, "a skin";
    DmSurface crate::attached::Attached<GpuNormals>, "a surface";
    DmWeightBounds crate::bounds::WeightBounds, "bounds from weights";
}
