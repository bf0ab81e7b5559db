//! How a host draws a head from 16-bit fixed-point poses in its own vertex buffer, with vertex attributes and
//! `glsl/host/pose.glsl` only.
//!
//!     cargo run --example draw [PART OF A DEVICE'S NAME]
//!
//! Updates write each pose into the host's interleaved vertices, beside a colour that is the host's alone. Such poses
//! take half the bytes of float32 ones. The example draws an expression into `head.ppm`; `tests/after/pictures.rs`
//! compares pictures with those of float32 poses. The device comes from the package `headless`; `examples/minimal.rs`
//! is a host with its own.

pub(crate) mod offscreen;

use deltamorph::ash::vk;
use deltamorph::{
    CrowdDesc, DeltaFormat, HostPoses, MorphSource, PackedLayout, PackedMesh, PoseFormat, Semantic, Tolerance,
    UpdateDesc, VertexLayout,
};
use deltamorph_head as head;
use deltamorph_headless::{DeviceChoice, Headless, HeadlessDesc};
use glam::{Mat4, Vec3};
use offscreen::{Offscreen, Result};

/// Red, green, blue, opacity.
pub type Pixel = [u8; 4];

/// The shader is the same for all pose formats, whose attributes are at locations 0 and 1.
const VERTEX: &str = "
    layout(push_constant) uniform Push { mat4 view; };
    layout(location = 2) in vec4 colour;
    layout(location = 0) out vec3 normal;
    layout(location = 1) out vec3 albedo;
    void main() {
        gl_Position = view * vec4(pose_position(), 1.0);
        normal = pose_normal();
        albedo = colour.rgb;
    }";
const FRAGMENT: &str = "#version 450
    layout(location = 0) in vec3 normal;
    layout(location = 1) in vec3 albedo;
    layout(location = 0) out vec4 pixel;
    void main() {
        float light = 0.5 + 0.5 * dot(normalize(normal), vec3(0.36, 0.48, 0.8));
        pixel = vec4(albedo * light, 1.0);
    }";
/// Colours of skin, eyes, teeth and mouth.
const COLOURS: [Pixel; 4] = [[230, 179, 153, 255], [235, 235, 230, 255], [240, 236, 220, 255], [166, 84, 84, 255]];
const BACKGROUND: [f32; 4] = [0.5, 0.39, 0.33, 1.0];

/// Draws the built-in head from poses in a format, once for each list of weights, into `edge` × `edge` pixels.
pub fn pictures(headless: &Headless, format: PoseFormat, frames: &[Vec<f32>], edge: u32) -> Result<Vec<Vec<Pixel>>> {
    let (engine, source) = (headless.engine(), head::head(&head::HeadDesc::default()));
    let mesh = PackedMesh::pack(&source.to_mesh(Tolerance::default())?, &engine.pack_desc(DeltaFormat::Fast))?;
    // SAFETY: `upload` hands out a recording buffer, and waits for it.
    let uploaded = headless.upload(|cmd| unsafe { engine.upload(cmd, &mesh) })?;

    let host = Offscreen::new(headless, edge, vk::Format::R8G8B8A8_UNORM)?;
    let (update, at) = (UpdateDesc::blocks().pose(format), format.stride());
    let vertex = VertexLayout::new(at as u32 + 4).stream(Semantic::Position, 0).stream(Semantic::Normal, at as u32 / 2);
    // A pose for each slot; all that updates write of a vertex is the pose.
    let colours = colours(&source, mesh.layout())?.repeat(update.slots as usize);
    let vertices: Vec<u8> = colours.into_iter().flat_map(|colour| [&vec![0; at][..], &colour].concat()).collect();
    // SAFETY: the buffer is large enough, is dropped after the crowd, and only the draws below read it.
    let poses = unsafe { HostPoses::new(host.filled(&vertices)?, 0, vertex) };
    let mut crowd = engine.create_crowd(&uploaded, &CrowdDesc::new(update).poses(Some(poses)))?;

    let pixels = host.shared((edge * edge) as usize * size_of::<Pixel>(), vk::BufferUsageFlags::TRANSFER_DST)?;
    let triangles = &mesh.layout().indices;
    let indices = host.filled(triangles)?;
    // The declarations of `pose.glsl` for the format, and the matching bindings and attributes.
    let version = format!("#version 450\n#define POSE_{}\n", format.decoder().to_uppercase());
    let shader = version + include_str!("../../glsl/host/pose.glsl") + VERTEX;
    let mut input = format.vertex_input(false);
    input.0[0].stride = vertex.stride();
    let colour = vk::VertexInputAttributeDescription::default().location(2).format(vk::Format::R8G8B8A8_UNORM);
    input.1.push(colour.offset(at as u32));
    let (pipeline, layout) = host.pipeline([&shader, FRAGMENT], &input, 64)?;
    let view = view(&source.positions);

    let drawn = frames.iter().map(|weights| {
        crowd.set_weights(0, weights)?;
        headless.run(|cmd| {
            // SAFETY: `cmd` is recording on the engine's device, outside a render pass, and runs once.
            unsafe { engine.record_update(cmd, &mut crowd) }?;
            let pose = crowd.pose(0)?;
            // From the numbers of the pose to the mesh, then to the view.
            let push: Vec<u8> = (view * pose.matrix()).to_cols_array().into_iter().flat_map(f32::to_ne_bytes).collect();
            // SAFETY: `cmd` is in a render pass; all bound objects are alive, and match the pipeline. The update has
            // made the pose ready for vertex attributes.
            host.record(cmd, BACKGROUND, &pixels, || unsafe {
                host.device.cmd_bind_pipeline(cmd, vk::PipelineBindPoint::GRAPHICS, pipeline);
                host.device.cmd_push_constants(cmd, layout, vk::ShaderStageFlags::VERTEX, 0, &push);
                host.device.cmd_bind_vertex_buffers(cmd, 0, &[pose.buffer], &[pose.offset]);
                host.device.cmd_bind_index_buffer(cmd, indices, 0, vk::IndexType::UINT32);
                host.device.cmd_draw_indexed(cmd, triangles.len() as u32, 1, 0, 0, 0);
            });
            Ok(())
        })?;
        Ok(host.contents(&pixels))
    });
    drawn.collect()
}

/// Returns a colour for each vertex, in pose-buffer order. Parts of the head have tiles of texture coordinates.
fn colours(source: &MorphSource, layout: &PackedLayout) -> deltamorph::Result<Vec<Pixel>> {
    let mut places: Vec<u32> = (0..layout.vertex_count as u32).collect();
    layout.remap_indices(&mut places)?;
    let mut colours = vec![COLOURS[0]; layout.padded_vertices()];
    for face in source.faces.iter() {
        let u = face.iter().filter_map(|corner| Some(source.texcoords[corner.texcoord? as usize].x)).sum::<f32>();
        let part = (u / face.len() as f32) as usize;
        face.iter().for_each(|corner| colours[places[corner.position as usize] as usize] = COLOURS[part.min(3)]);
    }
    Ok(colours)
}

/// Returns a view of all these positions, from the front and slightly above.
fn view(positions: &[Vec3]) -> Mat4 {
    let (low, high) = positions.iter().fold((Vec3::MAX, Vec3::MIN), |(low, high), p| (low.min(*p), high.max(*p)));
    let scale = Mat4::from_scale(Vec3::new(1.8, -1.8, -0.5) / (high - low).max_element());
    let turn = Mat4::from_rotation_x(0.2) * Mat4::from_translation(-(low + high) / 2.0);
    Mat4::from_translation(Vec3::Z * 0.5) * scale * turn
}

fn main() -> Result<()> {
    let choice = std::env::args().nth(1).map_or(DeviceChoice::Best, DeviceChoice::Name);
    let headless = Headless::new(&HeadlessDesc::default().device(choice))?;
    let clip = head::head_clip(&head::HeadDesc::default(), 60, 30.0);
    let weights = clip.values[42 * clip.names.len()..][..clip.names.len()].to_vec();
    let (edge, format) = (512, PoseFormat::Fixed16);
    let picture = pictures(&headless, format, &[weights], edge)?.concat();
    let rgb = picture.iter().flat_map(|[r, g, b, _]| [*r, *g, *b]);
    let file: Vec<u8> = format!("P6 {edge} {edge} 255\n").into_bytes().into_iter().chain(rgb).collect();
    std::fs::write("head.ppm", file)?;
    println!("{}: head.ppm, drawn from {} bytes a vertex", headless.caps().name, format.stride());
    Ok(())
}
