//! deltamorph: a morph-target (blend shape) engine that applies only the changed weights, on raw Vulkan.
//!
//! The engine borrows your device and records into your command buffers; it never submits, waits, or creates a queue or
//! thread. What to call, in order:
//!
//! 1. Mesh: [`Mesh::open`] or [`Mesh::from_arrays`], then [`Mesh::pack`]; or [`PackedMesh::read`]
//!    of what was packed before. [`import::open`] reads either, and finds clips.
//! 2. Device: [`requirements`] before you create it, [`MorphEngine::new`] after.
//! 3. [`MorphEngine::upload`] the mesh, [`MorphEngine::create_crowd`].
//! 4. Each frame: [`Crowd::set_weights`], [`MorphEngine::record_update`], and draw from [`Crowd::pose`]; motion vectors
//!    take [`Crowd::previous_pose`]. Post-morph passes (skinning, normals of the surface, float32 of any pose) are
//!    in [`after`]; [`WeightBounds`] are for culling. [`MorphEngine::readback`] reads poses back.
//!
//! ```no_run
//! use deltamorph::ash::{self, vk};
//! use deltamorph::{CrowdDesc, DeltaFormat, DeviceDesc, Mesh, MorphEngine, Result, UpdateDesc};
//!
//! /// `run` hands out a command buffer of yours that is recording, submits it, and waits.
//! fn morph(
//!     (instance, physical_device, device): (&ash::Instance, vk::PhysicalDevice, &ash::Device),
//!     mut run: impl FnMut(&mut dyn FnMut(vk::CommandBuffer) -> Result<()>) -> Result<()>,
//! ) -> Result<()> {
//!     // SAFETY: the handles are alive and belong together, and outlive the engine and all it makes.
//!     let engine = unsafe { MorphEngine::new(&DeviceDesc::new(instance, physical_device, device)) }?;
//!     let mesh = Mesh::open("face")?.pack(&engine.pack_desc(DeltaFormat::Fast))?;
//!     let _indices = &mesh.layout().indices; // for your index buffer: triangles of the vertices of poses
//!     let mut uploaded = None;
//!     // SAFETY: `cmd` is recording and runs once; the mesh outlives what the device does with it.
//!     run(&mut |cmd| {
//!         uploaded = Some(unsafe { engine.upload(cmd, &mesh) }?);
//!         Ok(())
//!     })?;
//!     let uploaded = uploaded.expect("`run` has called the function");
//!     let mut crowd = engine.create_crowd(&uploaded, &CrowdDesc::new(UpdateDesc::blocks()))?;
//!     let mut weights = vec![0.0; uploaded.layout().targets.len()];
//!     for frame in 0..60 {
//!         weights[0] = frame as f32 / 60.0;
//!         crowd.set_weights(0, &weights)?; // adds to the pose what changed since the last update
//!         // SAFETY: as above; `cmd` is outside a render pass, and updates run in the order in which they are
//!         // recorded.
//!         run(&mut |cmd| unsafe { engine.record_update(cmd, &mut crowd) }.map(drop))?;
//!         let pose = crowd.pose(0)?; // draw: bind pose.buffer at pose.offset as a vertex buffer of pose.stride
//! #       let _ = pose;
//!     }
//!     Ok(())
//! }
//! ```
//!
//! [`MorphEngine`] says what the caller is responsible for; `examples/minimal.rs` is a complete host. Without Vulkan,
//! [`CpuCrowd`] takes the same descriptions. [`mod@reference`] tells how far a pose is from a float64 evaluation.
//!
//! # Features
//! `obj` is on by default. Without `obj`, `csv` and `gltf`, names of targets are compared without Unicode
//! normalisation.
//! - `obj`: meshes from folders of OBJ files.
//! - `csv`: weight clips from CSV files.
//! - `gltf`: meshes, weight animations and skins from glTF files.
//! - `threads`: the path `cpu` and the importer on several threads.
//! - `baselines`: the kernels of published techniques, which the package deltamorph-baselines implements.
//! - `compile-shaders`: compile `glsl/` at build time, which needs a C++ compiler; without it the modules checked in
//!   under `spirv/` are linked.

// Modules below the GPU boundary (ARCHITECTURE.md) allow it, each time with a reason.
#![deny(unsafe_code)]
// A new variant of an enum is a compile error wherever the enum is matched.
#![cfg_attr(not(test), deny(clippy::wildcard_enum_match_arm))]
// Without the feature, items that only packages of this repository use would be reported as unused.
#![cfg_attr(not(feature = "internals"), allow(dead_code, unused_imports))]

// What unit tests share with other tests, which name this crate.
#[cfg(test)]
extern crate self as deltamorph;

mod abi;
pub mod after;
mod asset;
mod cpu;
mod crowd;
#[allow(unsafe_code)]
mod engine;
mod error;
#[allow(unsafe_code)]
mod gpu;
pub mod import;
mod io;
pub mod lod;
mod math;
mod names;
mod pack;
mod plan;
pub mod reference;
mod simd;
#[cfg(test)]
mod testing;
mod update;
mod weights;

#[doc(hidden)]
pub use asset::KeptMesh;
pub use asset::{Mesh, MeshArrays, Semantic, TargetArrays, Tolerance};
pub use cpu::CpuCrowd;
pub use engine::{
    Crowd, GpuMesh, MorphEngine, PoseBuffer, PoseReadback, PoseView, ReadPose, StreamView, Ticket, Update,
};
pub use error::{Error, Result};
pub use gpu::caps::DeviceCaps;
pub use gpu::device::DeviceDesc;
pub use pack::blocks::BlockDesc;
pub use pack::{DeltaFormat, POSE_FLOATS, PackDesc, PackedLayout, PackedMesh, PoseError, PoseFormat};
pub use plan::bounds::{Bounds, WeightBounds};
pub use plan::{BatchSize, Consumers, UpdateDesc, UpdateMode, UpdatePath, UpdateStats};
pub use update::animated::{AnimationDesc, Clips, KeyFormat, Playback};
pub use update::crowd::CrowdDesc;
pub use update::requirements;
pub use weights::{BoundClip, Repeat, WeightClip, normalise_weights};
pub use {ash, glam, gpu_allocator};

/// What a [`Mesh`] holds: faces, targets, and streams of values for each vertex.
pub mod mesh {
    #[doc(hidden)]
    pub use crate::asset::KeptTarget;
    #[doc(hidden)]
    pub use crate::asset::StreamPlace;
    pub use crate::asset::{Corner, Faces, MorphTarget, RenderVertices, StreamData, StreamDeltas};
}

/// What a [`PackedLayout`] holds: targets, and the grid of fixed-point poses.
pub mod packed {
    pub use crate::pack::PackedTarget;
    pub use crate::pack::blocks::BLOCK_SIZES;
    #[doc(hidden)]
    pub use crate::pack::blocks::PoseGrid;
}

/// What [`DeviceCaps`] and [`requirements`] tell of a device.
pub mod device {
    pub use crate::gpu::caps::Requirement;
}

/// Device memory: allocators, functions of the host's in their place, and what the engine takes.
pub mod memory {
    pub use crate::gpu::allocation::{HostMemory, MemoryRequest, MemorySource};
    pub use crate::gpu::device::SharedAllocator;
    pub use crate::gpu::statistics::{MemoryStats, MemoryUse};
}

/// Items that packages of this repository, their tests and techniques from outside use; no part of the API.
#[cfg(feature = "internals")]
#[doc(hidden)]
pub mod internals {
    pub use crate::error::Printable;
    pub use crate::io::{TEXT_MAX, is_device, read_bounded, unfinished, write_replacing};
    pub use crate::math::{angle_degrees, diagonal};

    /// Re-exports all public items of these modules.
    macro_rules! opened {
        ($($room:ident)*) => {
            $(pub mod $room {
                pub use crate::$room::*;
            })*
        };
    }
    opened!(abi asset gpu pack plan update weights);
}

/// The code of the documents has to compile.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
#[doc = include_str!("../docs/hosts.md")]
struct Readme;
