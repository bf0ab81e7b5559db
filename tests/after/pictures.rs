//! Pictures that a host draws from fixed-point poses, with vertex attributes and `glsl/host/pose.glsl` only, equal
//! those of float32 poses.

use crate::gpu;
use crate::offscreen::Offscreen;
use crate::testing;
use deltamorph::ash::vk;
use deltamorph::{CrowdDesc, DeltaFormat, POSE_FLOATS, PoseFormat, Semantic, Tolerance, UpdateDesc};
use deltamorph_head::{HeadDesc, head};
use deltamorph_headless::HeadlessCrowd;

/// Red, green, blue, opacity.
type Pixel = [u8; 4];

/// Draws a head from poses at locations from 3 on: the pose, or the previous one.
const VERTEX: &str = "
    layout(push_constant) uniform Push { mat4 to_mesh; };
    layout(location = 0) out vec3 normal;
    void main() {
    #ifdef POSE_PREVIOUS
        vec4 position = to_mesh * vec4(previous_position(), 1.0);
        normal = previous_normal() + 0.0 * pose_normal();
    #else
        vec4 position = to_mesh * vec4(pose_position(), 1.0);
        normal = pose_normal();
    #endif
        gl_Position = vec4(position.xyz * vec3(0.06, -0.06, 0.03) + vec3(0, 0, 0.5), 1.0);
    }";
const FRAGMENT: &str = "#version 450
    layout(location = 0) in vec3 normal;
    layout(location = 0) out vec4 pixel;
    void main() { pixel = vec4(0.5 + 0.5 * normalize(normal), 1.0); }";

#[test]
fn poses_of_every_format_are_drawn_alike_and_previous_ones_from_attributes_of_their_own() {
    let desc = HeadDesc { vertices: 900, targets: 37, ..Default::default() };
    let mesh = head(&desc).kept(Tolerance::default()).expect("a mesh");
    let edge = 128;
    for driver in gpu::drivers() {
        gpu::on_device(&driver, false, |headless, engine| {
            let mut expected: Option<Vec<Pixel>> = None;
            for format in PoseFormat::ALL {
                let packed = gpu::packed(engine, &mesh, DeltaFormat::Fast);
                let update = CrowdDesc::new(UpdateDesc { pose: format, ..UpdateDesc::blocks() });
                let mut crowd = HeadlessCrowd::new(headless, &packed, &update).expect("a crowd");
                let host = Offscreen::new(headless, edge, vk::Format::R8G8B8A8_UNORM).expect("an image");
                let mut triangles = mesh.faces.triangles(&mesh.positions).concat();
                packed.layout().remap_indices(&mut triangles).expect("indices of the mesh");
                let indices = host.filled(&triangles).expect("a buffer");
                let bytes = (edge * edge) as usize * size_of::<Pixel>();
                let pixels = host.shared(bytes, vk::BufferUsageFlags::TRANSFER_DST).expect("a buffer");
                let pipeline = |previous: bool| {
                    let defines = format!("#version 450\n#define POSE_{}\n", format.decoder().to_uppercase());
                    let defines =
                        defines + "#define POSE_LOCATION 3\n" + if previous { "#define POSE_PREVIOUS\n" } else { "" };
                    let vertex = defines + include_str!("../../glsl/host/pose.glsl") + VERTEX;
                    let (bindings, mut attributes) =
                        if previous { format.vertex_input_with_previous() } else { format.vertex_input() };
                    attributes.iter_mut().for_each(|attribute| attribute.location += 3);
                    host.pipeline([&vertex, FRAGMENT], &(bindings, attributes), 64).expect("a pipeline")
                };
                let draw = |crowd: &HeadlessCrowd<'_>, (pipeline, layout), previous| {
                    let pose = crowd.crowd().pose(0).expect("a pose");
                    let before = crowd.crowd().previous_pose(0).expect("a pose").expect("two slots");
                    let bound = [Some(pose), Some(before).filter(|_| previous)];
                    let (buffers, offsets): (Vec<_>, Vec<_>) =
                        bound.into_iter().flatten().map(|view| (view.buffer, view.offset)).unzip();
                    let drawn = headless.run(|cmd| {
                        // SAFETY: `cmd` is in a render pass; all bound objects are alive, and match the pipeline.
                        host.record(cmd, [0.0; 4], &pixels, || unsafe {
                            let push = pose.matrix().to_cols_array().map(f32::to_ne_bytes).concat();
                            host.device.cmd_bind_pipeline(cmd, vk::PipelineBindPoint::GRAPHICS, pipeline);
                            host.device.cmd_push_constants(cmd, layout, vk::ShaderStageFlags::VERTEX, 0, &push);
                            host.device.cmd_bind_vertex_buffers(cmd, 0, &buffers, &offsets);
                            host.device.cmd_bind_index_buffer(cmd, indices, 0, vk::IndexType::UINT32);
                            host.device.cmd_draw_indexed(cmd, triangles.len() as u32, 1, 0, 0, 0);
                        });
                        Ok(())
                    });
                    drawn.expect("a draw");
                    host.contents::<Pixel>(&pixels)
                };
                let (now, before) = (pipeline(false), pipeline(true));
                crowd.step(&[&[0.3; 37]]).expect("a step");
                let first = draw(&crowd, now, false);
                crowd.step(&[&[0.6; 37]]).expect("a step");
                let second = draw(&crowd, now, false);
                let shown = second.iter().filter(|pixel| pixel[3] > 0).count();
                assert!(shown > 1000 && first != second, "{driver} {format:?}: {shown} pixels");
                assert!(draw(&crowd, before, true) == first, "{driver} {format:?}");
                // Edges of the head may move by less than a pixel.
                let expected = expected.get_or_insert_with(|| second.clone());
                let is_off = |(a, b): &(&Pixel, &Pixel)| (0..4).any(|i| a[i].abs_diff(b[i]) > 4);
                let off = second.iter().zip(&*expected).filter(is_off).count();
                assert!(off * 200 < shown, "{driver} {format:?}: {off} of {shown} pixels are others than in float32");
            }
        });
    }
}

#[test]
fn views_say_what_streams_of_integer_poses_are() {
    gpu::on_every_device(|headless, engine| {
        let mesh = testing::with_streams(testing::mesh(300, 20));
        let packed = gpu::packed(engine, &mesh, DeltaFormat::Fast);
        let update = CrowdDesc::new(UpdateDesc { pose: PoseFormat::Fixed16, ..UpdateDesc::blocks() });
        let mut crowd = HeadlessCrowd::new(headless, &packed, &update).expect("a crowd");
        crowd.step(&[&[0.5; 20]]).expect("a step");
        assert_eq!(crowd.crowd().pose(0).expect("a pose").stride, 12);
        for (group, stored) in packed.groups().iter().zip(0..) {
            let stored = crowd.read_stored(0, stored).expect("a pose");
            let first = crowd.crowd().stream(0, group.layout().streams[0].semantic).expect("a stream");
            let grid = group.layout().grid(PoseFormat::Fixed16, None).expect("a grid");
            let integers = PoseFormat::Fixed16.integers(&stored);
            for place in &group.layout().streams {
                let view = crowd.crowd().stream(0, place.semantic).expect("a stream");
                assert_eq!((view.format, view.stride, view.buffer), (PoseFormat::Fixed16, 12, first.buffer));
                let components = view.components as usize;
                assert_eq!(view.units[..components], grid.units[place.components()], "{view:?}");
                assert_eq!(view.offsets[..components], grid.offsets[place.components()], "{view:?}");
                // The components of vertex 7, read as a host would.
                let at = (view.offset - first.offset) as usize + 7 * view.stride as usize;
                let read = stored[at..][..2 * view.components as usize].chunks(2);
                let read = read.map(|bytes| i32::from(i16::from_ne_bytes([bytes[0], bytes[1]])));
                assert!(read.eq(place.components().map(|component| integers[7 * POSE_FLOATS + component])));
            }
        }
        testing::says(crowd.crowd().stream(0, Semantic::Color(7)), &["'color 7'", "position, normal"]);
    });
}
