//! Recomputed normals: those of the morphed surface, against float64; only what changed is written; and how far morphed
//! normals are from them.

use crate::data;
use crate::gpu;
use crate::offscreen::Offscreen;
use crate::written::Written;
use deltamorph::after::{GpuNormals, NormalsDesc, NormalsTarget};
use deltamorph::ash::vk;
use deltamorph::import::{csv, obj};
use deltamorph::reference::{angle_degrees, evaluate_unpacked, normals};
use deltamorph::{Consumers, CrowdDesc, DeltaFormat, MorphMesh, PackedMesh, Tolerance, UpdateDesc};
use deltamorph_head::{HeadDesc, head};
use deltamorph_headless::{Headless, HeadlessCrowd};
use glam::DVec3;

/// What recomputed normals may be off by, in degrees.
const NORMAL: f64 = 0.5;

/// A head with a seam in its texture coordinates, whose vertices are doubled there.
pub fn mesh() -> MorphMesh {
    let source = head(&HeadDesc::default().vertices(900).targets(37).sparsity(0.05).seed(3));
    let split = source.split().expect("a split head");
    assert!(split.positions.len() > source.positions.len(), "there is a seam");
    split.to_mesh(Tolerance::default()).expect("a mesh")
}

fn corners(mesh: &MorphMesh) -> Vec<u32> {
    mesh.faces.corners.iter().map(|corner| corner.position).collect()
}

pub fn upload(headless: &Headless, mesh: &PackedMesh, desc: &NormalsDesc<'_>) -> GpuNormals {
    // SAFETY: the buffer is recording, runs once, and is waited for.
    let uploaded = headless.run(|cmd| unsafe { headless.engine().upload_normals(cmd, mesh, desc) });
    let mut uploaded = uploaded.expect("a surface");
    // SAFETY: it has run.
    unsafe { uploaded.release_staging() };
    uploaded
}

/// The largest angle between normals, in degrees; `f` is handed each, too.
fn compare(found: &[DVec3], expected: &[f64], mut f: impl FnMut(f64)) -> f64 {
    let expected = expected.as_chunks::<3>().0.iter().map(|n| DVec3::from_array(*n));
    let angles = found.iter().zip(expected).filter(|(_, expected)| expected.length() > 0.5);
    angles.map(|(found, expected)| angle_degrees(*found, expected)).inspect(|angle| f(*angle)).fold(0.0, f64::max)
}

#[test]
fn recomputed_normals_are_those_of_the_surface_and_only_what_changed_is_written() {
    let mesh = mesh();
    let corners = corners(&mesh);
    let surface_desc = NormalsDesc::new(&corners).sizes(&mesh.faces.sizes).welds(&mesh.welds);
    gpu::on_every_device(|headless, engine| {
        let host = Offscreen::new(headless, 1, vk::Format::R8G8B8A8_UNORM).expect("buffers");
        let mut worst: f64 = 0.0;
        for (format, update) in gpu::updates(headless) {
            let packed = gpu::packed(engine, &mesh, format);
            let vertices = packed.layout().vertex_count;
            let consumers = Consumers::VERTEX_ATTRIBUTES | Consumers::COPIES;
            let desc = CrowdDesc::new(update).instances(2).consumers(consumers);
            let mut crowd = HeadlessCrowd::new(headless, &packed, &desc).expect("a crowd");
            let surface = upload(headless, &packed, &surface_desc);
            let written = Written::new(headless, &host, vertices, (20, 28, None));
            let target = NormalsTarget::new(written.buffer).offset(20).stride(28);
            // SAFETY: the buffer is large enough, and lives as long as the crowd; nothing is running.
            unsafe { crowd.set_normals_target(1, Some((&surface, &target))) }.expect("a target");
            let mut held = vec![DVec3::NAN; vertices];
            let mut fewer = 0;
            for frame in 0..12 {
                let what = format!("{} {format:?} {update:?}, frame {frame}", headless.caps().name);
                let still = [4, 5].contains(&frame);
                let mut weights = gpu::weights(&packed, if still { 3 } else { frame }, 5);
                // Few of them change from frame to frame.
                weights.iter_mut().enumerate().for_each(|(t, w)| *w = if t % 5 == 0 { *w / 2.0 } else { 0.2 });
                crowd.step(&[&weights, &weights]).expect(&what);
                let mut count = 0;
                let user = |at: usize| packed.layout().user_vertex(at).expect("a vertex");
                for (at, words) in written.take(headless).into_iter().enumerate() {
                    if let Some(words) = words {
                        let number = |i: usize| f64::from(f32::from_bits(words[i]));
                        held[user(at)] = DVec3::new(number(0), number(1), number(2));
                        count += 1;
                    }
                }
                if still {
                    assert_eq!(count, 0, "{what}: nothing changed");
                    continue;
                }
                fewer += usize::from((1..vertices).contains(&count));
                let pose: Vec<f64> = gpu::reference(&packed, &update, &weights);
                let off = compare(&held, &normals(&pose, &surface_desc).expect("normals"), |_| ());
                assert!(off <= NORMAL, "{what}: {off} degrees");
                assert!(held.iter().all(|normal| (normal.length() - 1.0).abs() < 1e-5), "{what}: unit length");
                let welded = (0..vertices).find(|v| held[*v] != held[mesh.welds[*v] as usize]);
                assert_eq!(welded, None, "{what}: a seam shows");
                worst = worst.max(off);
            }
            assert_eq!(fewer > 0, format.is_blocks(), "{format:?} {update:?}: parts of a surface");
        }
        println!("{}: off by {worst:.1e} degrees", headless.caps().name);
    });
}

#[test]
fn surfaces_and_targets_that_do_not_fit_are_refused() {
    let mesh = mesh();
    let triangles = mesh.faces.triangles().into_flattened();
    gpu::on_every_device(|headless, engine| {
        let packed = gpu::packed(engine, &mesh, DeltaFormat::Fast);
        let refused = |desc: NormalsDesc<'_>| {
            // SAFETY: it is refused, and nothing is recorded.
            let uploaded = headless.run(|cmd| unsafe { engine.upload_normals(cmd, &packed, &desc) });
            uploaded.err().expect("a refusal").to_string()
        };
        assert!(refused(NormalsDesc::new(&[0, 1, 2, 0, 1, u32::MAX])).contains("names vertex 4294967295"));
        for (corners, sizes) in [(5, &[][..]), (6, &[3, 2]), (6, &[4, 2]), (6, &[u32::MAX, 7])] {
            assert!(refused(NormalsDesc::new(&[0; 6][..corners]).sizes(sizes)).contains("three corners or more"));
        }
        assert!(refused(NormalsDesc::new(&triangles).welds(&[0])).contains("1 welds for"));
        // One polygon, whose fans take the square of its corners: counted before they are made.
        let sides = 10 + (headless.caps().max_storage_range as f64 / 8.0).sqrt() as u32;
        let polygon: Vec<u32> = (0..sides).map(|i| i % packed.layout().vertex_count as u32).collect();
        let mut text = String::new();
        let memory = allocation_counter::measure(|| text = refused(NormalsDesc::new(&polygon).sizes(&[sides])));
        assert!(text.starts_with("surface of mesh '") && text.contains("split the mesh"), "{text}");
        assert!(memory.bytes_max < 1 << 20, "{} bytes for a polygon of {sides} corners", memory.bytes_max);
        let surface = upload(headless, &packed, &NormalsDesc::new(&triangles));
        let host = Offscreen::new(headless, 1, vk::Format::R8G8B8A8_UNORM).expect("buffers");
        let written = Written::new(headless, &host, packed.layout().vertex_count, (0, 12, None));
        let mut crowd = HeadlessCrowd::new(headless, &packed, &CrowdDesc::new(UpdateDesc::blocks())).expect("a crowd");
        let target = NormalsTarget::new(written.buffer);
        for wrong in [target.stride(8), target.stride(14), target.offset(2)] {
            // SAFETY: it is refused.
            let refused = unsafe { crowd.set_normals_target(0, Some((&surface, &wrong))) }.expect_err("a refusal");
            assert!(refused.to_string().contains("multiples of 4"), "{wrong:?}: {refused}");
        }
    });
}

/// Prints how far the normals that targets add up to are from those of the surface that they make, on captured clips:
/// with the normals of the files, and with normals that are computed on import, which are those of the surface at rest
/// and in each target.
#[test]
fn morphed_normals_against_those_of_the_surface_on_real_sets() {
    for set in ["ict_facekit", "makehuman_face", "facecap_head_glb"] {
        let Some(folder) = data::set(set) else { continue };
        let stated = obj::import_folder(&folder).expect("a folder");
        let mut computed = stated.clone();
        computed.normals = None;
        computed.targets.iter_mut().for_each(|target| target.normals = None);
        let clips = std::fs::read_dir(folder.join("weights")).expect("clips");
        let mut clips: Vec<_> = clips.map(|entry| entry.expect("an entry").path()).collect();
        clips.retain(|path| path.extension().is_some_and(|ending| ending == "csv"));
        for (source, which) in [(stated, "stated"), (computed, "computed")] {
            let mesh = source.to_mesh(Tolerance::default()).expect("a mesh");
            let corners = corners(&mesh);
            let desc = NormalsDesc::new(&corners).sizes(&mesh.faces.sizes).welds(&mesh.welds);
            let add_angles = |weights: &[f32], angles: &mut Vec<f64>| {
                let pose = evaluate_unpacked(&mesh, weights);
                let normal = |vertex: &[f64; 6]| DVec3::from_slice(&vertex[3..]);
                let morphed: Vec<DVec3> = pose.as_chunks().0.iter().map(normal).collect();
                compare(&morphed, &normals(&pose, &desc).expect("normals"), |angle| angles.push(angle));
            };
            let (mut rest, mut angles) = (vec![], vec![]);
            add_angles(&[], &mut rest);
            let names: Vec<&str> = mesh.targets.iter().map(|target| target.name.as_str()).collect();
            for clip in &clips {
                let clip = csv::read(clip, None).expect("a clip");
                let frames: Vec<Vec<f32>> = clip.bind(&names).expect("columns that name targets").frames().collect();
                frames.iter().step_by(frames.len().div_ceil(10)).for_each(|weights| add_angles(weights, &mut angles));
            }
            let [rest, angles] = [rest, angles].map(|mut angles| {
                angles.sort_by(f64::total_cmp);
                [0.5, 0.9, 0.99].map(|share| angles[((angles.len() - 1) as f64 * share) as usize])
            });
            println!("{set}, {which}: in the middle, at 90 % and at 99 % {angles:.2?}°; at rest {rest:.2?}°");
            assert!(which == "stated" || rest[2] < 0.01 && angles[0] < 1.0, "{set}: normals of another surface");
        }
    }
}
