//! Pictures of poses: positions, normals and texture coordinates as vertex attributes, and pixels that keep all bits.

use crate::offscreen::Offscreen;
pub use crate::offscreen::Shared;
use deltamorph::ash::vk;
use deltamorph::{PoseFormat, PoseView};
use deltamorph_headless::Headless;
use glam::Mat4;
use std::ops::Deref;

/// Width and height of the picture in pixels.
pub const EDGE: u32 = 256;
/// A pixel: u, v, light, and 1 if anything was drawn; the bits of float32.
pub type Pixel = [u32; 4];

const VERTEX: &str = "
    layout(location = 8) in vec2 texcoord;
    layout(location = 0) out vec3 shown;
    layout(push_constant) uniform Push { mat4 view; vec2 units; };
    void main() {
        gl_Position = view * vec4(pose_position(units), 1);
        shown = vec3(texcoord, dot(normalize(pose_normal(units)), vec3(0.36, 0.48, 0.8)));
    }";
const FRAGMENT: &str = "#version 450
    layout(location = 0) in vec3 shown;
    layout(location = 0) out vec4 pixel;
    void main() { pixel = vec4(shown, 1); }";

/// Triangles to draw, with or without an index buffer.
pub struct Triangles<'a> {
    /// Buffers and offsets of the pose and, for fixed-point poses, of the base pose.
    pub poses: &'a [(vk::Buffer, u64)],
    /// Units of the pose.
    pub units: [f32; 2],
    /// Texture coordinates of the vertices.
    pub texcoords: vk::Buffer,
    pub indices: Option<vk::Buffer>,
    /// Number of corners of all triangles.
    pub count: u32,
}

/// Draws poses in one format.
pub struct Picture<'a> {
    offscreen: Offscreen<'a>,
    pipeline: (vk::Pipeline, vk::PipelineLayout),
    pixels: Shared,
}

impl<'a> Deref for Picture<'a> {
    type Target = Offscreen<'a>;

    fn deref(&self) -> &Offscreen<'a> {
        &self.offscreen
    }
}

impl<'a> Picture<'a> {
    pub fn new(headless: &'a Headless, pose: PoseFormat) -> Self {
        let offscreen = Offscreen::new(headless, EDGE, vk::Format::R32G32B32A32_SFLOAT).unwrap();
        let (mut bindings, mut attributes) = pose.vertex_input(false);
        let binding = bindings.len() as u32;
        bindings.push(vk::VertexInputBindingDescription::default().binding(binding).stride(8));
        let format = vk::Format::R32G32_SFLOAT;
        attributes.push(vk::VertexInputAttributeDescription { location: 8, binding, format, offset: 0 });
        let version = format!("#version 450\n#define POSE_{}\n", pose.decoder().to_uppercase());
        let vertex = version + include_str!("../../glsl/host/pose.glsl") + VERTEX;
        let pipeline = offscreen.pipeline([&vertex, FRAGMENT], &(bindings, attributes), 72).unwrap();
        let bytes = (EDGE * EDGE) as usize * size_of::<Pixel>();
        let pixels = offscreen.shared(bytes, vk::BufferUsageFlags::TRANSFER_DST).unwrap();
        Self { offscreen, pipeline, pixels }
    }

    /// Draws in front of nothing. `cmd` is recording outside a render pass, and the pose is ready for vertex
    /// attributes.
    pub fn draw(&self, cmd: vk::CommandBuffer, triangles: &Triangles<'_>, view: &Mat4) {
        let Triangles { poses, units, texcoords, indices, count } = *triangles;
        let (device, (pipeline, layout)) = (self.device, self.pipeline);
        let push: Vec<u8> = view.to_cols_array().into_iter().chain(units).flat_map(f32::to_ne_bytes).collect();
        let (buffers, offsets): (Vec<_>, Vec<_>) = poses.iter().copied().chain([(texcoords, 0)]).unzip();
        // SAFETY: `cmd` is recording in a render pass; all other objects are alive, and large enough.
        self.record(cmd, [0.0; 4], &self.pixels, || unsafe {
            device.cmd_bind_pipeline(cmd, vk::PipelineBindPoint::GRAPHICS, pipeline);
            device.cmd_push_constants(cmd, layout, vk::ShaderStageFlags::VERTEX, 0, &push);
            device.cmd_bind_vertex_buffers(cmd, 0, &buffers, &offsets);
            match indices {
                Some(indices) => {
                    device.cmd_bind_index_buffer(cmd, indices, 0, vk::IndexType::UINT32);
                    device.cmd_draw_indexed(cmd, count, 1, 0, 0, 0);
                }
                None => device.cmd_draw(cmd, count, 1, 0, 0),
            }
        });
    }

    /// Records a copy of a pose written by compute passes or transform feedback. `cmd` is recording outside a render
    /// pass.
    pub fn record_pose_copy(&self, cmd: vk::CommandBuffer, pose: &PoseView, to: &Shared) {
        use vk::{AccessFlags as Access, PipelineStageFlags as Stage};
        let copies = Stage::TRANSFER;
        self.barrier(cmd, (Stage::ALL_COMMANDS, Access::MEMORY_WRITE), (copies, Access::TRANSFER_READ));
        let region = [vk::BufferCopy { src_offset: pose.offset, dst_offset: 0, size: pose.size }];
        // SAFETY: `cmd` is recording; both have `pose.size` bytes.
        unsafe { self.device.cmd_copy_buffer(cmd, pose.buffer, to.buffer, &region) };
        // The next update, which may write this pose, waits as well.
        let after = (Stage::HOST | Stage::ALL_COMMANDS, Access::HOST_READ | Access::MEMORY_WRITE);
        self.barrier(cmd, (copies, Access::TRANSFER_WRITE), after);
    }

    /// Decodes a copied pose; `base` is the base pose of the mesh.
    pub fn pose(&self, copied: &Shared, view: &PoseView, base: &[f32]) -> Vec<f32> {
        view.format.decode(&self.contents::<u8>(copied), base, view.units)
    }

    /// Returns the last picture, row by row.
    pub fn pixels(&self) -> Vec<Pixel> {
        self.contents(&self.pixels)
    }
}
