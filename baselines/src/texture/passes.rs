//! The passes of `texture`: rectangles drawn into displacement textures.

use super::blending::add_blending;
use super::images::write_image;
use super::{Textures, words_of};
use crate::abi::modules::{Kernel, RECTANGLES, TEXELS};
use crate::gpu::descriptors::Sets;
use crate::gpu::device::Device;
use crate::gpu::mesh::MeshBuffers;
use crate::gpu::pipelines::{Objects, PipelineKey, Pipelines};
use crate::pack::{DeltaFormat, PoseFormat};
use crate::update::technique::Context;
use crate::weights::delta::Coefficient;
use bytemuck::bytes_of;
use deltamorph::Result;
use deltamorph::ash::vk;
use deltamorph::shader_structure;
use deltamorph_headless::{Image, ImageDesc, framebuffer, render_pass};
use std::sync::Arc;

shader_structure! {
    /// Push constants of `baselines/rectangles.vert` and `baselines/texels.frag`.
    RectanglesPush {
        /// Scale from texels to clip space: 2 / size of the displacement textures.
        scale: [f32; 2],
        /// Coefficients of positions and normals, in steps of the target's deltas.
        coefficients: [f32; 2],
        /// Texels per row of the delta textures.
        row: u32,
    }
}

const FORMAT: vk::Format = vk::Format::R32G32B32A32_SFLOAT;
const STAGES: vk::ShaderStageFlags =
    vk::ShaderStageFlags::from_raw(vk::ShaderStageFlags::VERTEX.as_raw() | vk::ShaderStageFlags::FRAGMENT.as_raw());

/// The pipeline that blends the deltas of a format; its render pass clears.
#[derive(Clone, Copy, PartialEq)]
struct Blend(DeltaFormat);

impl PipelineKey for Blend {
    fn make(self, objects: &mut Objects) -> Result<()> {
        objects.add_layout(&[RECTANGLES.row, TEXELS.row], 0)?;
        objects.render_pass = blending(&objects.device, true)?;
        let module = |kernel: &'static Kernel| kernel.module(self.0.row(), PoseFormat::Float32.row(), 0);
        add_blending(objects, [module(&RECTANGLES)?, module(&TEXELS)?])
    }
}

/// Makes a render pass over both displacement textures, which draws find in SHADER_READ_ONLY_OPTIMAL. It clears them,
/// or loads the result of an earlier such pass.
fn blending(device: &Device, clears: bool) -> Result<vk::RenderPass> {
    use vk::{AccessFlags as Access, PipelineStageFlags as Stage};
    let (load, layout) = if clears {
        (vk::AttachmentLoadOp::CLEAR, vk::ImageLayout::UNDEFINED)
    } else {
        (vk::AttachmentLoadOp::LOAD, vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL)
    };
    let attachment = vk::AttachmentDescription::default()
        .format(FORMAT)
        .samples(vk::SampleCountFlags::TYPE_1)
        .load_op(load)
        .store_op(vk::AttachmentStoreOp::STORE)
        .stencil_load_op(vk::AttachmentLoadOp::DONT_CARE)
        .stencil_store_op(vk::AttachmentStoreOp::DONT_CARE)
        .initial_layout(layout)
        .final_layout(vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL);
    let layout = vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL;
    let colours = [0, 1].map(|attachment| vk::AttachmentReference { attachment, layout });
    let subpass = vk::SubpassDescription::default().color_attachments(&colours);
    let blend = Access::COLOR_ATTACHMENT_READ | Access::COLOR_ATTACHMENT_WRITE;
    // Layouts change between the barriers before the pass, which end in this stage, and those after it, which begin
    // with this stage or with the stages of draws.
    let dependencies = [
        vk::SubpassDependency::default()
            .src_subpass(vk::SUBPASS_EXTERNAL)
            .src_stage_mask(Stage::COLOR_ATTACHMENT_OUTPUT)
            .dst_stage_mask(Stage::COLOR_ATTACHMENT_OUTPUT)
            .dst_access_mask(blend),
        vk::SubpassDependency::default()
            .dst_subpass(vk::SUBPASS_EXTERNAL)
            .src_stage_mask(Stage::COLOR_ATTACHMENT_OUTPUT)
            .src_access_mask(blend)
            .dst_stage_mask(Stage::COLOR_ATTACHMENT_OUTPUT | Stage::VERTEX_SHADER)
            .dst_access_mask(blend | Access::SHADER_READ),
    ];
    render_pass(device, &[attachment; 2], &subpass, &dependencies)
}

/// The displacement textures of an instance: layer 0 is positions, layer 1 normals.
struct Displacements {
    _image: Image,
    /// Both layers, for draws to fetch.
    view: vk::ImageView,
    framebuffer: vk::Framebuffer,
}

/// The arguments for a crowd's passes.
pub struct BlendPasses {
    kernel: Arc<Pipelines<Blend>>,
    mesh: Arc<MeshBuffers>,
    /// Loads the result of an earlier pass.
    loading: vk::RenderPass,
    displacements: Vec<Displacements>,
    sets: Sets,
}

impl BlendPasses {
    pub fn new(context: Context<'_>) -> Result<Self> {
        let (device, mesh) = (context.device, context.mesh);
        let kernel = context.kernels.get(Blend(mesh.layout.format))?;
        let sets = kernel.objects.sets(&[[words_of(mesh)]])?;
        let images = &Textures::of(mesh).images;
        (1..).zip(images).for_each(|(binding, image)| write_image(device, sets.get(0), binding, image.views[0]));
        // From here on, dropping `passes` destroys the objects made so far.
        let mut passes =
            Self { loading: blending(device, false)?, kernel, mesh: mesh.clone(), displacements: vec![], sets };
        let (name, size) =
            (format!("deltamorph displacements of mesh '{}'", mesh.layout.name), Textures::of(mesh).size);
        let usage = vk::ImageUsageFlags::COLOR_ATTACHMENT | vk::ImageUsageFlags::SAMPLED;
        let desc = ImageDesc { size, layers: 2, format: FORMAT, samples: vk::SampleCountFlags::TYPE_1, usage };
        for _ in 0..context.desc.instances {
            let mut image = Image::new(device, &name, &desc)?;
            let (view, layers) = (image.view(0..2, true)?, [image.view(0..1, false)?, image.view(1..2, false)?]);
            // SAFETY: the render pass and the views are ours and alive, of the same format and size.
            let framebuffer = unsafe { framebuffer(device, passes.loading, &layers, size) }?;
            passes.displacements.push(Displacements { _image: image, view, framebuffer });
        }
        Ok(passes)
    }

    /// Returns the displacement textures by instance, for draws to fetch.
    pub fn displacements(&self) -> Vec<vk::ImageView> {
        self.displacements.iter().map(|displacements| displacements.view).collect()
    }

    /// Records a pass over the displacement textures of an instance.
    ///
    /// # Safety
    /// - `cmd` is in the recording state on the device, outside a render pass, on a queue with graphics.
    /// - The targets are the mesh's; unless the pass clears, an earlier one has.
    /// - Earlier reads and writes of the displacement textures have finished, by a barrier.
    pub unsafe fn record(&self, cmd: vk::CommandBuffer, instance: u32, clears: bool, coefficients: &[Coefficient]) {
        let (objects, textures) = (&self.kernel.objects, Textures::of(&self.mesh));
        let (device, point) = (&objects.device.raw, vk::PipelineBindPoint::GRAPHICS);
        let [width, height] = textures.size;
        let extent = vk::Extent2D { width, height };
        let area = vk::Rect2D { offset: vk::Offset2D::default(), extent };
        let (scale, row) = ([2.0 / width as f32, 2.0 / height as f32], textures.images[0].desc.size[0]);
        let viewport =
            vk::Viewport { width: width as f32, height: height as f32, max_depth: 1.0, ..vk::Viewport::default() };
        let clear = [vk::ClearValue::default(); 2];
        let info = vk::RenderPassBeginInfo::default()
            .render_pass(if clears { objects.render_pass } else { self.loading })
            .framebuffer(self.displacements[instance as usize].framebuffer)
            .render_area(area)
            .clear_values(&clear);
        // SAFETY: the caller's obligations; all objects are ours and alive, both render passes are compatible with the
        // framebuffer and the pipeline.
        unsafe {
            device.cmd_begin_render_pass(cmd, &info, vk::SubpassContents::INLINE);
            device.cmd_bind_pipeline(cmd, point, objects.pipelines[0]);
            device.cmd_set_viewport(cmd, 0, &[viewport]);
            device.cmd_set_scissor(cmd, 0, &[area]);
            device.cmd_bind_descriptor_sets(cmd, point, objects.layout, 0, &[self.sets.get(0)], &[]);
        }
        for c in coefficients {
            let target = &self.mesh.layout.targets[c.target as usize];
            let coefficient = c.value * target.position_step;
            let push = RectanglesPush { scale, coefficients: [coefficient, coefficient * target.normal_ratio()], row };
            let rectangles = textures.rectangles(c.target);
            // SAFETY: as above; the rectangles are within the buffer bound, their texels within the textures.
            unsafe {
                device.cmd_push_constants(cmd, objects.layout, STAGES, 0, bytes_of(&push));
                device.cmd_draw(cmd, 4, rectangles.len() as u32, 0, rectangles.start);
            }
        }
        // SAFETY: begun above.
        unsafe { device.cmd_end_render_pass(cmd) };
    }
}

impl Drop for BlendPasses {
    fn drop(&mut self) {
        let device = &self.kernel.objects.device.raw;
        // SAFETY: created in `new`, destroyed once, and no longer used by the device when a crowd is dropped.
        unsafe {
            self.displacements.iter().for_each(|d| device.destroy_framebuffer(d.framebuffer, None));
            device.destroy_render_pass(self.loading, None);
        }
    }
}
