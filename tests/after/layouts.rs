//! Outputs in vertices of applications: their buffers, offsets, strides, formats and order, with the values that the
//! pose has on the CPU. Everything else in the buffers stays as it is. The mesh has no indices.

use crate::prelude::*;
use glam::DVec3;
use vk::Format;

/// Initial bytes of all buffers.
const POISON: u8 = 0xa5;
/// Bytes of a buffer, and where second outputs begin.
const BYTES: usize = 1 << 17;
const SECOND: u64 = 1 << 16;

/// A stream of a layout: number of the buffer, stream, offset, stride, format.
type Place = (usize, Semantic, u64, u32, Format);

struct Layout {
    places: Vec<Place>,
    pose_order: bool,
    in_turn: bool,
}

fn layouts() -> Vec<Layout> {
    use Semantic::*;
    let interleaved = vec![
        (0, Position, 0, 88, Format::R32G32B32_SFLOAT),
        (0, Normal, 12, 88, Format::R32G32B32_SFLOAT),
        (0, TexCoord(0), 24, 88, Format::R32G32_SFLOAT),
        (0, Color(0), 40, 88, Format::R32G32B32A32_SFLOAT),
        (0, Tangent, 64, 88, Format::R32G32B32A32_SFLOAT),
    ];
    let apart = vec![
        (0, Position, 0, 12, Format::R32G32B32_SFLOAT),
        (1, Normal, 0, 4, Format::R8G8B8A8_SNORM),
        (2, Tangent, 0, 4, Format::R8G8B8A8_SNORM),
    ];
    let packed = vec![
        (0, Normal, 268, 4, Format::A2B10G10R10_SNORM_PACK32),
        (1, Position, 0, 16, Format::R32G32B32A32_SFLOAT),
        (0, Tangent, 4096, 8, Format::R16G16B16A16_SNORM),
        (2, Mask, 4, 12, Format::R32G32_SFLOAT),
    ];
    let short = vec![
        (0, Position, 16, 36, Format::R32G32B32_SFLOAT),
        (0, Normal, 28, 36, Format::R16G16B16A16_SNORM),
        (0, Tangent, 12, 36, Format::A2B10G10R10_SNORM_PACK32),
    ];
    let layout = |places, pose_order, in_turn| Layout { places, pose_order, in_turn };
    vec![
        layout(interleaved, false, false),
        layout(apart.clone(), true, false),
        layout(apart, false, true),
        layout(packed, false, false),
        layout(short, true, true),
    ]
}

/// Asserts that the numbers of a vertex at these bytes are `expected`, and returns how many bytes of them are written.
fn check(bytes: &[u8], (_, semantic, _, _, format): Place, expected: &[f32], what: &str) -> usize {
    let word = |i: usize| u32::from_ne_bytes(bytes[4 * i..][..4].try_into().unwrap());
    let morphing = semantic.morphing_components();
    let unit = || DVec3::from_array(std::array::from_fn(|i| expected[i].into())).normalize_or_zero();
    // Numbers, how many of them are 1, and how far they may be off beside rounding.
    let (found, scale, off): (Vec<f64>, f64, f64) = match format {
        Format::R8G8B8A8_SNORM => ((0..3).map(|i| f64::from(bytes[i] as i8)).collect(), 127.0, 0.51),
        Format::R16G16B16A16_SNORM => {
            let number = |i: usize| i16::from_ne_bytes([bytes[2 * i], bytes[2 * i + 1]]).into();
            ((0..3).map(number).collect(), 32767.0, 0.6)
        }
        Format::A2B10G10R10_SNORM_PACK32 => {
            ((0..3).map(|i| f64::from((word(0) << (22 - 10 * i)) as i32 >> 22)).collect(), 511.0, 0.51)
        }
        _ => ((0..morphing).map(|i| f32::from_bits(word(i)).into()).collect(), 1.0, 1e-6),
    };
    match semantic {
        Semantic::Normal | Semantic::Tangent => {
            let error = (DVec3::from_slice(&found) - unit() * scale).abs().max_element();
            assert!(error <= off, "{what}: {found:?} is {error} from {:?}", unit() * scale);
        }
        _ => assert!((0..morphing).all(|i| word(i) == expected[i].to_bits()), "{what}: {found:?}, not {expected:?}"),
    }
    // What is kept beside three numbers of two words and of one.
    match format {
        Format::R16G16B16A16_SNORM => assert_eq!(bytes[6..8], [POISON; 2], "{what}: w"),
        Format::R8G8B8A8_SNORM => assert_eq!(bytes[3], POISON, "{what}: w"),
        Format::A2B10G10R10_SNORM_PACK32 => assert_eq!(bytes[3] >> 6, POISON >> 6, "{what}: w"),
        _ => return 4 * morphing,
    }
    if format == Format::R16G16B16A16_SNORM { 8 } else { 4 }
}

/// Where not every combination runs, each layout with one kind of update.
#[test]
fn layouts_of_applications_hold_the_pose_and_nothing_else_changes() {
    gpu::on_every_driver(|headless, engine| {
        let host = Buffers::new(headless);
        let updates = gpu::updates(headless);
        let all = gpu::runs_all(headless);
        for (number, layout) in layouts().iter().enumerate() {
            let chosen = |i: &usize| all || *i == number % updates.len();
            for &(format, update) in (0..updates.len()).filter(chosen).map(|i| &updates[i]) {
                holds(headless, &host, &gpu::packed(engine, &mesh(), format), update, layout);
            }
        }
    });
}

fn mesh() -> KeptMesh {
    testing::with_streams(testing::mesh(300, 11))
}

fn holds(headless: &Headless, host: &Buffers<'_>, mesh: &PackedMesh, update: UpdateDesc, layout: &Layout) {
    let vertices = mesh.layout().vertex_count;
    let buffers = [(); 3].map(|()| host.shared(BYTES));
    buffers.iter().for_each(|buffer| host.fill(buffer, u32::from_ne_bytes([POISON; 4])));
    let stream = |&(buffer, semantic, offset, stride, format): &Place| {
        let buffer = buffers[buffer].buffer;
        let second = layout.in_turn.then_some((buffer, offset + SECOND));
        OutputStream { offset, stride, format, second, ..OutputStream::new(semantic, buffer) }
    };
    let streams: Vec<OutputStream> = layout.places.iter().map(stream).collect();
    let target = OutputTarget { pose_order: layout.pose_order, ..OutputTarget::new(&streams) };
    let desc = CrowdDesc { instances: 2, ..CrowdDesc::new(update) };
    let mut crowd = HeadlessCrowd::new(headless, mesh, &desc).expect("a crowd");
    // SAFETY: the buffers are large enough, and live as long as the crowd; nothing is running.
    unsafe { crowd.set_output_target(1, Some(&target)) }.expect("a target");
    for frame in 0..4 {
        let what = format!("{} {update:?} {streams:?}, frame {frame}", headless.caps().name);
        let weights = [0, 1].map(|seed| gpu::weights(mesh, frame, seed).iter().map(|w| w / 2.0).collect::<Vec<_>>());
        crowd.step(&weights.each_ref().map(Vec::as_slice)).expect("a step");
        let view = crowd.crowd().output(1).expect("an output");
        let first = layout.places[0];
        let half = view.current.1 - first.2;
        assert!(half == 0 || layout.in_turn && half == SECOND, "{what}");
        let mut contents = buffers.each_ref().map(|buffer| host.contents::<u8>(buffer));
        let poses: Vec<Vec<f32>> =
            (0..mesh.groups().len()).map(|group| crowd.read_group(1, group).expect("a pose").0).collect();
        for (place, stream) in layout.places.iter().zip(&streams) {
            let of = |(group, of): (usize, &deltamorph::internals::pack::PackedGroup)| {
                let places = of.layout().streams.iter();
                places.clone().find(|found| found.semantic == stream.semantic).map(|found| (group, found.first))
            };
            let (group, at) = mesh.groups().iter().enumerate().find_map(of).expect("a stream");
            for vertex in 0..vertices {
                let user =
                    if layout.pose_order { mesh.layout().user_vertex(vertex).expect("a vertex") } else { vertex };
                let expected = &poses[group][6 * user + at..6 * user + 6];
                let begin = (stream.offset + half) as usize + vertex * stream.stride as usize;
                let bytes = &mut contents[place.0];
                let written = check(&bytes[begin..], *place, expected, &what);
                bytes[begin..][..written].fill(POISON);
                if layout.in_turn {
                    let other = (stream.offset + SECOND - half) as usize + vertex * stream.stride as usize;
                    bytes[other..][..written].fill(POISON);
                }
            }
        }
        for bytes in &contents {
            assert_eq!(bytes.iter().position(|byte| *byte != POISON), None, "{what}: the application's bytes");
        }
    }
}

/// Prints the device times of updates into vertices of applications, over those of the library's buffers alone: medians
/// of updates in turns, of a mesh as large as ict_facekit, of whose weights 21 change.
#[test]
#[ignore = "a measurement"]
fn times() {
    let full = Format::R32G32B32_SFLOAT;
    let interleaved = |stride, format| [(0, 0, stride, full), (0, 12, stride, format)];
    let layouts = [
        ("a vertex of 88 bytes", interleaved(88, full)),
        ("two buffers of 12 bytes", [(0, 0, 12, full), (1, 0, 12, full)]),
        ("16 bytes, normals of 8 bits", interleaved(16, Format::R8G8B8A8_SNORM)),
        ("16 bytes, normals of 10 bits", interleaved(16, Format::A2B10G10R10_SNORM_PACK32)),
        ("20 bytes, normals of 16 bits", interleaved(20, Format::R16G16B16A16_SNORM)),
    ];
    gpu::on_device(&gpu::one(), false, |headless, engine| {
        let host = Buffers::new(headless);
        let desc = HeadDesc { vertices: 28_911, targets: 57, sparsity: 0.15, seed: 3 };
        let mesh = gpu::packed(engine, &head(&desc).kept(Tolerance::default()).expect("a mesh"), DeltaFormat::Fast);
        for pose in [PoseFormat::Float32, PoseFormat::Fixed16] {
            let crowd = || gpu::crowd(headless, &mesh, UpdateDesc { pose, slots: 1, ..UpdateDesc::blocks() });
            let mut crowds = vec![crowd()];
            for (places, pose_order) in
                layouts.iter().flat_map(|(_, places)| [true, false].map(|order| (places, order)))
            {
                let buffers = [(); 2].map(|()| host.shared(28_911 * 88).buffer);
                let semantics = [Semantic::Position, Semantic::Normal];
                let stream = |(&(buffer, offset, stride, format), semantic): (&(usize, u64, u32, Format), Semantic)| {
                    OutputStream { offset, stride, format, ..OutputStream::new(semantic, buffers[buffer]) }
                };
                let streams: Vec<OutputStream> = places.iter().zip(semantics).map(stream).collect();
                let mut crowd = crowd();
                let target = OutputTarget { pose_order, ..OutputTarget::new(&streams) };
                // SAFETY: the buffers are large enough, and live as long as the crowd; nothing is running.
                unsafe { crowd.set_output_target(0, Some(&target)) }.expect("a target");
                crowds.push(crowd);
            }
            let mut times = vec![vec![]; crowds.len()];
            let (mut rng, mut weights) = (Rng::new(1, 0), vec![0.0; 57]);
            for frame in 0..110 {
                (0..21).for_each(|_| weights[rng.below(57)] = rng.range(0.0, 1.0));
                for (crowd, times) in crowds.iter_mut().zip(&mut times) {
                    let step = crowd.step(&[&weights]).expect("a step");
                    times.extend(step.gpu_ms.filter(|_| frame >= 10));
                }
            }
            times.iter_mut().for_each(|times| times.sort_by(f64::total_cmp));
            let medians: Vec<f64> = times.iter().map(|times| times[times.len() / 2]).collect();
            println!("| {} | {:.3} ms | |", pose.name(), medians[0]);
            for ((name, _), times) in layouts.iter().zip(medians[1..].chunks(2)) {
                println!("| {name} | {:.2} | {:.2} |", times[0] / medians[0], times[1] / medians[0]);
            }
        }
    });
}
