//! Normals of the morphed surface, in place of sums of the targets' normal deltas.

use crate::memory::{Buffer, buffer};
use crate::scene::{Head, Scale};
use deltamorph::after::{OutputStream, OutputTarget};
use deltamorph::ash::vk::BufferUsageFlags as Usage;
use deltamorph::internals::gpu::device::Device;
use deltamorph::{Crowd, PackedMesh, Result, Semantic};
use deltamorph_headless::Headless;
use std::sync::Arc;

/// Bytes of a vertex: position and normal in float32.
const VERTEX: usize = 24;

/// The vertices that are drawn in place of the poses.
pub struct Normals {
    output: Buffer,
    /// Bytes per head.
    size: usize,
}

impl Normals {
    /// Has all updates of `crowd` write normals of the surface.
    pub fn new(headless: &Headless, gpu: &Arc<Device>, packed: &PackedMesh, crowd: &mut Crowd) -> Result<Self> {
        let engine = headless.engine();
        let heads = crowd.desc().instances as usize;
        let size = VERTEX * packed.layout().vertex_count;
        let output = buffer(gpu, heads * size, Usage::STORAGE_BUFFER | Usage::VERTEX_BUFFER)?;
        // SAFETY: the buffer is recording, runs once, and is waited for.
        let mut surface = headless.run(|cmd| unsafe { engine.upload_normals(cmd, packed) })?;
        surface.release_staging();
        let stride = VERTEX as u32;
        for head in 0..heads {
            let offset = (head * size) as u64;
            let stream = |semantic, at| {
                [OutputStream { offset: offset + at, stride, ..OutputStream::new(semantic, output.raw) }]
            };
            let (positions, normals) = (stream(Semantic::Position, 0), stream(Semantic::Normal, 12));
            let target = |streams| OutputTarget { pose_order: true, ..OutputTarget::new(streams) };
            // SAFETY: no update is running; the buffer is large enough, and lives as long as the crowd.
            unsafe {
                engine.set_output_target(crowd, head as u32, Some(&target(&positions)))?;
                engine.set_normals_target(crowd, head as u32, Some((&surface, &target(&normals))))?;
            }
        }
        Ok(Self { output, size })
    }

    /// Returns the head with these vertices in place of its pose.
    pub fn head(&self, number: usize, head: Head) -> Head {
        let buffer = self.output.raw;
        let offset = (number * self.size) as u64;
        Head { buffer, offset, scale: Scale::ONE, previous: (buffer, offset), ..head }
    }
}
