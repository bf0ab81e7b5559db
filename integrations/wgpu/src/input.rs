//! Vertex inputs of pipelines that draw poses.

use super::invalid;
use deltamorph::ash::vk;
use deltamorph::{PoseFormat, Result};

/// WGSL functions that read poses, to be placed before your own shader; comments in the text describe them.
pub const POSE_WGSL: &str = include_str!("../wgsl/pose.wgsl");

/// Input of a pipeline that draws poses: vertex buffers, and the WGSL that goes with them.
///
/// Vertex buffers are the pose ([`Crowd::pose`](crate::Crowd::pose)) and, for motion vectors, the previous pose. Each
/// has two attributes.
#[derive(Clone, Debug)]
pub struct VertexInput {
    format: PoseFormat,
    /// Stride and attributes of each vertex buffer.
    buffers: Vec<(u64, Vec<wgpu::VertexAttribute>)>,
}

impl VertexInput {
    /// Describes poses of a format, in locations from `location` on; with `previous`, also the previous pose.
    ///
    /// # Errors
    /// wgpu has no vertex attributes for the format, which no current format causes.
    pub fn new(format: PoseFormat, location: u32, previous: bool) -> Result<Self> {
        let (bindings, attributes) = if previous { format.vertex_input_with_previous() } else { format.vertex_input() };
        let attribute = |a: &vk::VertexInputAttributeDescription| {
            let unknown = || invalid(format!("vertex attributes of {:?}", a.format), "use poses of float32");
            let (offset, shader_location) = (u64::from(a.offset), location + a.location);
            Ok(wgpu::VertexAttribute { format: vertex_format(a.format).ok_or_else(unknown)?, offset, shader_location })
        };
        let buffer = |b: &vk::VertexInputBindingDescription| {
            let attributes = attributes.iter().filter(|a| a.binding == b.binding).map(attribute);
            Ok((u64::from(b.stride), attributes.collect::<Result<_>>()?))
        };
        Ok(Self { format, buffers: bindings.iter().map(buffer).collect::<Result<_>>()? })
    }

    /// Returns the layouts for [`VertexState::buffers`](wgpu::VertexState::buffers), before or after those of your own.
    pub fn layouts(&self) -> Vec<Option<wgpu::VertexBufferLayout<'_>>> {
        let step_mode = wgpu::VertexStepMode::Vertex;
        let buffers = self.buffers.iter();
        buffers
            .map(|(stride, attributes)| Some(wgpu::VertexBufferLayout { array_stride: *stride, step_mode, attributes }))
            .collect()
    }

    /// Returns the WGSL to put before the shader: [`POSE_WGSL`], and
    ///
    /// ```wgsl
    /// struct PoseInput { … } // an argument of the vertex shader, beside others of your own
    /// fn pose_input(in: PoseInput) -> PoseVertex // position and normal
    /// fn previous_input(in: PoseInput) -> PoseVertex // with `previous`
    /// ```
    ///
    /// [`PoseView::matrix`](deltamorph::PoseView::matrix), equal for all instances of a crowd, makes positions of the
    /// mesh of these: multiply the model matrix by it from the right. Normals are directions, not normalised.
    pub fn wgsl(&self) -> String {
        let (mut fields, mut functions) = (String::new(), String::new());
        for (name, (_, attributes)) in ["pose", "previous"].into_iter().zip(&self.buffers) {
            for (i, attribute) in attributes.iter().enumerate() {
                let (location, ty) = (attribute.shader_location, type_of(attribute.format));
                fields += &format!("    @location({location}) {name}_{i}: {ty},\n");
            }
            let read = format!("pose_{}(in.{name}_0, in.{name}_1)", self.format.decoder());
            functions += &format!("fn {name}_input(in: PoseInput) -> PoseVertex {{\n    return {read};\n}}\n");
        }
        format!("{POSE_WGSL}\nstruct PoseInput {{\n{fields}}}\n{functions}")
    }
}

/// Returns the type of an attribute in WGSL.
fn type_of(format: wgpu::VertexFormat) -> &'static str {
    match format {
        wgpu::VertexFormat::Sint32x3 => "vec3i",
        wgpu::VertexFormat::Sint16x4 => "vec4i",
        wgpu::VertexFormat::Sint16x2 => "vec2i",
        _ => "vec3f",
    }
}

fn vertex_format(format: vk::Format) -> Option<wgpu::VertexFormat> {
    match format {
        vk::Format::R32G32B32_SFLOAT => Some(wgpu::VertexFormat::Float32x3),
        vk::Format::R32G32B32_SINT => Some(wgpu::VertexFormat::Sint32x3),
        vk::Format::R16G16B16A16_SINT => Some(wgpu::VertexFormat::Sint16x4),
        vk::Format::R16G16_SINT => Some(wgpu::VertexFormat::Sint16x2),
        _ => None,
    }
}
