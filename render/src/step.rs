//! Steps after the pose, whose outputs are drawn in place of the pose.

use crate::memory::{Buffer, Gpu};
use crate::scene::Head;
use bytemuck::cast_slice;
use deltamorph::after::{DecodeTarget, GpuSkin, NormalsDesc, NormalsTarget, SkinDesc, SkinMethod, SkinTarget};
use deltamorph::ash::vk::BufferUsageFlags as Usage;
use deltamorph::{Crowd, MorphEngine, PackedMesh, Result};
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
    /// Linear-blend skinning, with the joints of [`Studio::set_joints`](crate::Studio::set_joints).
    Skin(SkinDesc<'a>),
    /// Normals of the morphed surface, instead of sums of the targets' normal deltas.
    Normals(NormalsDesc<'a>),
}

/// The inputs and outputs of a step for each head.
pub struct Stepped {
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
        (headless, gpu): (&Headless, &Arc<Gpu>),
        packed: &PackedMesh,
        crowd: &mut Crowd,
        step: &Step<'_>,
        frames: usize,
    ) -> Result<Option<Self>> {
        let (engine, heads) = (headless.engine(), crowd.desc().instances as usize);
        let size = VERTEX * packed.layout().vertex_count;
        let output = || Buffer::new(gpu, heads * size.max(4), Usage::STORAGE_BUFFER | Usage::VERTEX_BUFFER, false);
        let each = (0..heads).map(|head| (head as u32, (head * size) as u64));
        match step {
            Step::None => Ok(None),
            Step::Skin(desc) => {
                // SAFETY: the buffer is recording, runs once, and is waited for.
                let mut skin = headless.run(|cmd| unsafe { engine.upload_skin(cmd, packed, desc) })?;
                // SAFETY: the upload has run.
                unsafe { skin.release_staging() };
                // SAFETY: nothing is running; the studio waits before it drops its parts.
                unsafe { Self::skinned(gpu, engine, packed, crowd, (&skin, desc.joint_count), frames) }.map(Some)
            }
            Step::Normals(desc) => {
                let output = output()?;
                // SAFETY: as above.
                let mut surface = headless.run(|cmd| unsafe { engine.upload_normals(cmd, packed, desc) })?;
                // SAFETY: the upload has run.
                unsafe { surface.release_staging() };
                let (positions, stride) = (DecodeTarget::new(output.raw), VERTEX as u32);
                for (head, offset) in each {
                    let positions = positions.offset(offset).stride(stride);
                    let normals = NormalsTarget::new(output.raw).offset(offset + 12).stride(stride);
                    // SAFETY: as above.
                    unsafe {
                        engine.set_decode_target(crowd, head, Some(&positions))?;
                        engine.set_normals_target(crowd, head, Some((&surface, &normals)))?;
                    }
                }
                Ok(Some(Self { output, size, joints: None }))
            }
        }
    }

    /// [`Renderer::skinned`](crate::Renderer::skinned), under its conditions.
    pub(crate) unsafe fn skinned(
        gpu: &Arc<Gpu>,
        engine: &MorphEngine,
        packed: &PackedMesh,
        crowd: &mut Crowd,
        (skin, joint_count): (&GpuSkin, u32),
        frames: usize,
    ) -> Result<Self> {
        let (heads, size) = (crowd.desc().instances as usize, VERTEX * packed.layout().vertex_count);
        let output = Buffer::new(gpu, heads * size.max(4), Usage::STORAGE_BUFFER | Usage::VERTEX_BUFFER, false)?;
        let size_of_joints = SkinMethod::Linear.joint_bytes() as usize * joint_count as usize;
        let buffer = Buffer::new(gpu, frames * heads * size_of_joints, Usage::STORAGE_BUFFER, false)?;
        let target = SkinTarget::new(output.raw, buffer.raw, (frames * heads * size_of_joints) as u64);
        for head in 0..heads {
            let target = target.offset((head * size) as u64);
            // SAFETY: the buffers are large enough, and live as long as the crowd's updates: the caller's obligation.
            unsafe { engine.set_skin_target(crowd, head as u32, Some((skin, &target))) }?;
        }
        let numbers = vec![STILL.repeat(joint_count as usize); heads];
        Ok(Self { output, size, joints: Some(Joints { buffer, size: size_of_joints, numbers }) })
    }

    /// Sets the joints of a head; returns whether their number is right.
    pub fn set_joints(&mut self, head: usize, joints: &[f32]) -> bool {
        let numbers = self.joints.as_mut().and_then(|joints| joints.numbers.get_mut(head));
        let numbers = numbers.filter(|numbers| numbers.len() == joints.len());
        numbers.map(|numbers| numbers.copy_from_slice(joints)).is_some()
    }

    /// Writes the joints of the next update, for a frame that is not in flight.
    ///
    /// # Errors
    /// The crowd has no skin.
    pub fn write(&mut self, frame: usize, crowd: &mut Crowd) -> Result<()> {
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
    #[must_use]
    pub fn head(&self, number: usize, head: Head) -> Head {
        let (buffer, offset) = (self.output.raw, (number * self.size) as u64);
        let bounds = head.bounds.filter(|_| self.joints.is_none());
        Head { buffer, offset, units: [1.0; 2], previous: (buffer, offset), bounds, ..head }
    }
}
