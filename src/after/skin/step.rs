//! The device side of skinning.

use super::{SkinDesc, SkinMethod};
use crate::abi::modules::{SKIN, SKIN_DUAL};
use crate::abi::numbers::PIECE;
use crate::abi::push::SkinPush;
use crate::after::attached::Attached;
use crate::after::output::Output;
use crate::after::step::{AfterStep, Bound, Job, Pose, TargetContext};
use crate::after::steps::After;
use crate::error::{Error, Result, ensure};
use crate::gpu::descriptors::BufferRange;
use crate::gpu::device::Device;
use crate::gpu::mesh::Upload;
use crate::gpu::pipelines::{Objects, PipelineKey};
use crate::pack::{DeltaFormat, PackedMesh};
use crate::plan::steps::PostMorphPass;
use ash::vk;
use std::sync::Arc;

/// Joints and weights of a mesh on the device; see [`MorphEngine::upload_skin`](crate::MorphEngine::upload_skin).
/// Targets keep its buffers alive.
pub struct GpuSkin {
    attached: Arc<Attached>,
    influences: u32,
    joint_count: u32,
    staging: Option<Upload>,
}

impl GpuSkin {
    /// Records the upload.
    ///
    /// # Safety
    /// See [`MorphEngine::upload_skin`](crate::MorphEngine::upload_skin).
    pub(crate) unsafe fn upload(
        device: &Arc<Device>,
        cmd: vk::CommandBuffer,
        mesh: &PackedMesh,
        desc: &SkinDesc<'_>,
    ) -> Result<Self> {
        let words = desc.pack(mesh.layout())?;
        // SAFETY: the caller's obligations.
        let (attached, upload) = unsafe { Attached::upload(device, cmd, mesh, "skin", (&[], &words)) }?;
        let SkinDesc { influences, joint_count, .. } = *desc;
        Ok(Self { attached, influences, joint_count, staging: Some(upload) })
    }

    /// Frees the staging memory. Call it when the upload has finished, or if it will never run:
    /// [`MorphEngine::upload_skin`](crate::MorphEngine::upload_skin) requires that.
    pub fn release_staging(&mut self) {
        self.staging = None;
    }
}

/// Output of an instance's skinned pose, and its joints; see
/// [`MorphEngine::set_skin_target`](crate::MorphEngine::set_skin_target).
///
/// Vertices are in pose-buffer order, without padding:
/// [`PackedLayout::vertex_count`](crate::PackedLayout::vertex_count) in total.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SkinTarget {
    /// The output buffer, with storage buffer usage.
    pub buffer: vk::Buffer,
    /// Byte offset of the first vertex's position, a multiple of 4.
    pub offset: u64,
    /// Bytes per vertex, a multiple of 4.
    pub stride: u32,
    /// Bytes from a position to its normal, a multiple of 4 and at least 12; `None`: no normals. Normals have unit
    /// length.
    pub normals: Option<u32>,
    /// Second output buffer and offset, with the same stride. Updates write the two in turn, and the other one holds
    /// the [previous](SkinnedView::previous) skinned pose, for motion vectors, without a copy.
    pub second: Option<(vk::Buffer, u64)>,
    /// The buffer of joints, with storage buffer usage.
    pub joints: vk::Buffer,
    /// Bytes of that buffer, from its start, that contain joints.
    pub joints_bytes: u64,
    /// Byte offset of the instance's first joint, a multiple of 16, until
    /// [`Crowd::set_joints`](crate::Crowd::set_joints) sets another.
    pub joints_offset: u64,
    /// Blending method, which determines the layout of joints.
    pub method: SkinMethod,
}

impl SkinTarget {
    /// Contiguous positions and normals, 24 bytes per vertex, from the start of `buffer`; linear blending of matrices
    /// in the first `joints_bytes` bytes of `joints`.
    pub fn new(buffer: vk::Buffer, joints: vk::Buffer, joints_bytes: u64) -> Self {
        Self {
            buffer,
            offset: 0,
            stride: 24,
            normals: Some(12),
            second: None,
            joints,
            joints_bytes,
            joints_offset: 0,
            method: SkinMethod::Linear,
        }
    }

    fn outputs(&self) -> impl Iterator<Item = Output> {
        let Self { stride, normals: second, .. } = *self;
        let outputs = [Some((self.buffer, self.offset)), self.second].into_iter().flatten();
        outputs.map(move |(buffer, offset)| Output { buffer, offset, stride, second })
    }
}

/// Locations of an instance's skinned pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct SkinnedView {
    /// Buffer, and byte offset of the first position.
    pub current: (vk::Buffer, u64),
    /// The same before the last update; equal to `current` if nothing changed, on the first update and after a reset;
    /// `None` if the update overwrote it.
    pub previous: Option<(vk::Buffer, u64)>,
}

#[derive(Clone, Copy, PartialEq)]
struct Key(Pose, SkinMethod, u32);

impl PipelineKey for Key {
    fn make(self, objects: &mut Objects) -> Result<()> {
        let Self(pose, method, influences) = self;
        let kernel = match method {
            SkinMethod::Linear => &SKIN,
            SkinMethod::DualQuaternion => &SKIN_DUAL,
        };
        objects.add_layout(&[kernel.row], 0)?;
        objects.add_compute(
            kernel.module(DeltaFormat::Float32.row(), pose.format.row(), 0)?,
            &[&[&[influences][..], pose.constants()].concat()],
        )
    }
}

pub(crate) struct Skin {
    bound: Bound<Key>,
    outputs: Vec<(Output, u32)>,
    push: SkinPush,
    joints_bytes: u64,
    joint_count: u32,
    is_changed: bool,
    /// Keeps buffers of the sets alive.
    _attached: Arc<Attached>,
}

impl Skin {
    /// Sets the target of an instance.
    ///
    /// # Errors
    /// An invalid target or skin; no memory. Nothing changes then.
    pub fn set(after: &mut After, context: &TargetContext<'_>, (skin, target): (&GpuSkin, &SkinTarget)) -> Result<()> {
        let layout = &context.group.mesh.layout;
        let caps = &context.device.caps;
        skin.attached.check("a skin", context.device, layout)?;
        if target.normals.is_some() {
            context.check_normals("a skin target")?;
        }
        context.check("skinning")?;
        let pieces = (layout.vertex_count as u64).div_ceil(PIECE.into());
        let list = (pieces, "texels", caps.max_texels.into());
        let what = format!("the list of a skin target for mesh '{}' takes", layout.name);
        caps.check_limit(&what, list, "split the mesh")?;
        let joints = (target.joints_bytes, "bytes", caps.max_storage_range);
        caps.check_limit("the joints of a skin target take", joints, "split the buffer of joints")?;
        check_joints(target.joints_offset, target.method, skin.joint_count, target.joints_bytes)?;
        target.outputs().try_for_each(|output| output.check("a skin target", layout, context.device))?;
        let joints = BufferRange::new(target.joints, 0, target.joints_bytes);
        joints.check_room(context.device, "the range of joints of a skin target")?;
        let outputs = target.outputs().count();
        after.set(context, PostMorphPass::Skin, outputs, vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER, |lists| {
            let bound = |frame| {
                let list = BufferRange { size: 4 * pieces, ..lists.range(frame) };
                target
                    .outputs()
                    .map(move |output| [context.poses(), skin.attached.range(), joints, output.range(layout).0, list])
            };
            let bound: Vec<_> = (0..context.frames.into()).flat_map(bound).collect();
            let [units, offset] = context.scale();
            let push = SkinPush {
                units,
                offset,
                joints_at: (target.joints_offset / 16) as u32,
                stride: target.stride / 4,
                normal_at: target.normals.unwrap_or(0) / 4,
                vertices: layout.vertex_count as u32,
                // The rest is of each dispatch.
                ..Default::default()
            };
            let outputs = target.outputs().map(|output| (output, output.range(layout).1)).collect();
            Ok(Self {
                bound: Bound::new(context, Key(context.pose(), target.method, skin.influences), &bound)?,
                outputs,
                push,
                joints_bytes: target.joints_bytes,
                joint_count: skin.joint_count,
                is_changed: false,
                _attached: skin.attached.clone(),
            })
        })
    }

    /// Sets the offset of an instance's joints, which moved.
    ///
    /// # Errors
    /// An instance without a skin target; an invalid offset.
    pub fn set_joints(after: &mut After, instance: u32, offset: u64) -> Result<()> {
        let none = || Error::invalid(format!("instance {instance} is not skinned"), "set a skin target first");
        let skin: &mut Self = after.get_mut(PostMorphPass::Skin, instance).ok_or_else(none)?;
        check_joints(offset, skin.bound.kernel.key.1, skin.joint_count, skin.joints_bytes)?;
        (skin.push.joints_at, skin.is_changed) = ((offset / 16) as u32, true);
        Ok(())
    }

    /// Locations of an instance's skinned pose.
    ///
    /// # Errors
    /// An instance without a skin target, or without output so far.
    pub fn view(after: &After, instance: u32) -> Result<SkinnedView> {
        let none = || {
            let text = format!("instance {instance} has no skinned pose");
            Error::invalid(text, "set a skin target, and record an update")
        };
        let (skin, current, previous) = after.written::<Self>(PostMorphPass::Skin, instance).ok_or_else(none)?;
        let at = |output: usize| (skin.outputs[output].0.buffer, skin.outputs[output].0.offset);
        Ok(SkinnedView { current: at(current), previous: previous.map(at) })
    }
}

/// Checks that the joints are aligned and within their buffer.
fn check_joints(offset: u64, method: SkinMethod, count: u32, bytes: u64) -> Result<()> {
    let size = method.joint_bytes() * u64::from(count);
    let fits = offset.is_multiple_of(16) && offset.checked_add(size).is_some_and(|end| end <= bytes);
    let text = || format!("{count} joints of {size} bytes at offset {offset} of a buffer with {bytes} bytes of joints");
    ensure!(fits, text(), "use a multiple of 16, and a buffer with room for all joints after it");
    Ok(())
}

impl AfterStep for Skin {
    fn take_changed(&mut self) -> bool {
        std::mem::take(&mut self.is_changed)
    }

    unsafe fn record(&self, cmd: vk::CommandBuffer, job: &Job) {
        let listed = job.is_listed.into();
        let pose_at = self.bound.pose_at(job);
        let skinned_at = self.outputs[job.output].1;
        let push = SkinPush { pose_at, skinned_at, count: job.count, listed, ..self.push };
        let set = job.frame as usize * self.outputs.len() + job.output;
        // SAFETY: the caller's obligations; the list was made for this frame.
        unsafe { self.bound.dispatch(cmd, job, set, &push) };
    }
}
