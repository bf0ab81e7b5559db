//! Steps after the pose, whose outputs are drawn in place of the pose.

use crate::memory::{Buffer, Gpu};
use crate::scene::{Head, Scale};
use bytemuck::cast_slice;
use deltamorph::after::{DecodeTarget, NormalsDesc, NormalsTarget, SkinDesc, SkinMethod, SkinTarget};
use deltamorph::ash::vk::BufferUsageFlags as Usage;
use deltamorph::{Crowd, PackedMesh, Result};
use deltamorph_headless::Headless;
use std::sync::Arc;

/// Bytes per vertex of a step's output: position and normal in float32.
const VERTEX: usize = 24;
/// The first three rows of the identity.
const STILL: [f32; 12] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];

/// The step after the pose, before it is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Step<'a> {
    /// No step.
    #[default]
    None,
    /// Linear-blend skinning, with the joints of [`Heads::set_joints`](crate::Heads::set_joints).
    Skin(SkinDesc<'a>),
    /// Normals of the morphed surface, instead of sums of the targets' normal deltas.
    Normals(NormalsDesc<'a>),
}

/// The inputs and outputs of a step for each head.
pub(crate) struct Stepped {
    output: Buffer,
    /// Output bytes per head.
    size: usize,
    joints: Option<Joints>,
}

/// Joints of each head, with a copy for each frame in flight.
struct Joints {
    buffer: Buffer,
    /// Bytes of a head's joints.
    size: usize,
    numbers: Vec<Vec<f32>>,
}

impl Stepped {
    /// Adds `step` after all poses of `crowd`, with this many frames in flight.
    pub(crate) fn new(
        headless: &Headless,
        gpu: &Arc<Gpu>,
        packed: &PackedMesh,
        crowd: &mut Crowd,
        step: &Step<'_>,
        frames: usize,
    ) -> Result<Option<Self>> {
        if *step == Step::None {
            return Ok(None);
        }
        let engine = headless.engine();
        let heads = crowd.desc().instances as usize;
        let size = VERTEX * packed.layout().vertex_count;
        let output = Buffer::new(gpu, heads * size.max(4), Usage::STORAGE_BUFFER | Usage::VERTEX_BUFFER, false)?;
        let each = (0..heads).map(|head| (head as u32, (head * size) as u64));
        let mut joints = None;
        match step {
            Step::None => {}
            Step::Skin(desc) => {
                // SAFETY: the buffer is recording, runs once, and is waited for.
                let mut skin = headless.run(|cmd| unsafe { engine.upload_skin(cmd, packed, desc) })?;
                // SAFETY: the upload has run.
                unsafe { skin.release_staging() };
                let of_head = SkinMethod::Linear.joint_bytes() as usize * desc.joint_count as usize;
                let bytes = frames * heads * of_head;
                let buffer = Buffer::new(gpu, bytes, Usage::STORAGE_BUFFER, false)?;
                let target = SkinTarget::new(output.raw, buffer.raw, bytes as u64);
                for (head, offset) in each {
                    // SAFETY: no update is running; the buffers are large enough, and live as long as the crowd.
                    unsafe { engine.set_skin_target(crowd, head, Some((&skin, &target.offset(offset)))) }?;
                }
                let numbers = vec![STILL.repeat(desc.joint_count as usize); heads];
                joints = Some(Joints { buffer, size: of_head, numbers });
            }
            Step::Normals(desc) => {
                // SAFETY: the buffer is recording, runs once, and is waited for.
                let mut surface = headless.run(|cmd| unsafe { engine.upload_normals(cmd, packed, desc) })?;
                // SAFETY: the upload has run.
                unsafe { surface.release_staging() };
                let stride = VERTEX as u32;
                for (head, offset) in each {
                    let positions = DecodeTarget::new(output.raw).offset(offset).stride(stride);
                    let normals = NormalsTarget::new(output.raw).offset(offset + 12).stride(stride);
                    // SAFETY: no update is running; the buffer is large enough, and lives as long as the crowd.
                    unsafe {
                        engine.set_decode_target(crowd, head, Some(&positions))?;
                        engine.set_normals_target(crowd, head, Some((&surface, &normals)))?;
                    }
                }
            }
        }
        Ok(Some(Self { output, size, joints }))
    }

    /// Sets the joints of a head; returns whether their number is right.
    pub(crate) fn set_joints(&mut self, head: usize, joints: &[f32]) -> bool {
        let numbers = self.joints.as_mut().and_then(|joints| joints.numbers.get_mut(head));
        let numbers = numbers.filter(|numbers| numbers.len() == joints.len());
        numbers.map(|numbers| numbers.copy_from_slice(joints)).is_some()
    }

    /// Writes the joints of the next update, for a frame that is not in flight.
    pub(crate) fn write(&mut self, frame: usize, crowd: &mut Crowd) -> Result<()> {
        let Some(Joints { buffer, size, numbers }) = &mut self.joints else { return Ok(()) };
        let first = frame * numbers.len();
        for (head, joints) in numbers.iter().enumerate() {
            let offset = (first + head) * *size;
            buffer.write(offset, cast_slice(joints));
            crowd.set_joints(head as u32, offset as u64)?;
        }
        Ok(())
    }

    /// Returns the head with the step's output instead of its pose. Bounds are those of the pose, before skinning.
    pub(crate) fn head(&self, number: usize, head: Head) -> Head {
        let buffer = self.output.raw;
        let offset = (number * self.size) as u64;
        let bounds = head.bounds.filter(|_| self.joints.is_none());
        Head { buffer, offset, scale: Scale::ONE, previous: (buffer, offset), bounds, ..head }
    }
}
