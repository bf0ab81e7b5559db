//! The memory of the engine's objects, by what it is for.

use gpu_allocator::MemoryLocation;

/// Memory of one kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct MemoryUse {
    /// Bytes, as allocated for buffers (and images).
    pub bytes: u64,
    /// Number of buffers (and images).
    pub allocations: u64,
}

/// Each kind of memory: documentation, name, name in statistics, and where it is.
macro_rules! kinds {
    ($($(#[doc = $doc:literal])* $kind:ident $name:ident $location:ident;)*) => {
        /// What memory is for.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum MemoryKind {
            $($(#[doc = $doc])* $kind,)*
        }

        impl MemoryKind {
            /// Where it is allocated.
            pub const fn location(self) -> MemoryLocation {
                match self {
                    $(Self::$kind => MemoryLocation::$location,)*
                }
            }
        }

        /// Memory of an engine and everything made by it ([`MorphEngine::memory`](crate::MorphEngine::memory)).
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        #[non_exhaustive]
        pub struct MemoryStats {
            $($(#[doc = $doc])* pub $name: MemoryUse,)*
            /// Bytes that the allocator has from the driver, including unused parts of blocks; of the host's allocator,
            /// if one was passed in.
            pub allocated: u64,
        }

        impl MemoryStats {
            /// Bytes of all kinds.
            pub(super) fn total(&self) -> u64 {
                [$(self.$name.bytes),*].iter().sum()
            }

            pub(super) fn of(&mut self, kind: MemoryKind) -> &mut MemoryUse {
                match kind {
                    $(MemoryKind::$kind => &mut self.$name,)*
                }
            }
        }
    };
}

kinds! {
    /// Base poses, deltas, skins and surfaces.
    Meshes meshes GpuOnly;
    /// Poses in the engine's own buffers.
    Poses poses GpuOnly;
    /// Clips of crowds that are animated on the GPU, their weights and plans.
    Animation animation GpuOnly;
    /// Lists that the host writes for updates, for each frame in flight.
    Lists lists CpuToGpu;
    // The host's memory: the small part of a graphics card's memory that the host can write to is better left to lists.
    /// Staging memory of uploads, until it is released.
    Staging staging GpuToCpu;
    /// Poses read back.
    Readback readback GpuToCpu;
}
