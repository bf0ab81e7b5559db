//! Vertex inputs of pipelines that draw poses.

use super::invalid;
use deltamorph::ash::vk;
use deltamorph::{PoseFormat, Result};

/// WGSL functions that decode poses, to be placed before your own shader; comments in the text describe them.
pub const POSE_WGSL: &str = include_str!("../wgsl/pose.wgsl");

/// Input of a pipeline that draws poses: vertex buffers, and the WGSL that goes with them.
///
/// Vertex buffers are the pose ([`Crowd::pose`](crate::Crowd::pose)); for fixed-point formats the base pose
/// ([`Mesh::base_pose`](crate::Mesh::base_pose)); for motion vectors the previous pose. Each has two attributes.
#[derive(Clone, Debug)]
pub struct VertexInput {
    format: PoseFormat,
    previous: bool,
    /// Stride and attributes of each vertex buffer.
    buffers: Vec<(u64, Vec<wgpu::VertexAttribute>)>,
}

impl VertexInput {
    /// Describes poses of a format, in locations from `location` on; with `previous`, also the previous pose.
    ///
    /// # Errors
    /// wgpu has no vertex attributes for the format, which no current format causes.
    pub fn new(format: PoseFormat, location: u32, previous: bool) -> Result<Self> {
        let (bindings, attributes) = format.vertex_input(previous);
        let attribute = |a: &vk::VertexInputAttributeDescription| {
            let unknown = || invalid(format!("vertex attributes of {:?}", a.format), "use poses of float32");
            let (offset, shader_location) = (u64::from(a.offset), location + a.location);
            Ok(wgpu::VertexAttribute { format: vertex_format(a.format).ok_or_else(unknown)?, offset, shader_location })
        };
        let buffer = |b: &vk::VertexInputBindingDescription| {
            let attributes = attributes.iter().filter(|a| a.binding == b.binding).map(attribute);
            Ok((u64::from(b.stride), attributes.collect::<Result<_>>()?))
        };
        Ok(Self { format, previous, buffers: bindings.iter().map(buffer).collect::<Result<_>>()? })
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
    /// fn pose_input(in: PoseInput, units: vec2f) -> PoseVertex // position and normal
    /// fn previous_input(in: PoseInput, units: vec2f) -> PoseVertex // with `previous`
    /// ```
    ///
    /// Results are in units of the mesh; normals are not normalised. `units` is
    /// [`PoseView::units`](deltamorph::PoseView::units), equal for all instances of a crowd; float32 poses ignore it.
    pub fn wgsl(&self) -> String {
        let base = if self.format.has_integers() { "in.base_0, in.base_1, units" } else { "" };
        let names = [Some("pose"), self.format.has_integers().then_some("base"), self.previous.then_some("previous")];
        let (mut fields, mut functions) = (String::new(), String::new());
        for (name, (_, attributes)) in names.into_iter().flatten().zip(&self.buffers) {
            for (i, attribute) in attributes.iter().enumerate() {
                let (location, ty) = (attribute.shader_location, type_of(attribute.format));
                fields += &format!("    @location({location}) {name}_{i}: {ty},\n");
            }
            if name != "base" {
                let decode = format!("pose_{}(in.{name}_0, in.{name}_1, {base})", self.format.decoder());
                let function = format!("fn {name}_input(in: PoseInput, units: vec2f) -> PoseVertex");
                functions += &format!("{function} {{\n    return {decode};\n}}\n");
            }
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
