//! glTF with a skin and morph targets: read, packed, updated and skinned on the device, read back, and compared with
//! the file's numbers evaluated in float64.

use crate::character::{Character, Stored};
use crate::gpu;
use crate::joints::Joints;
use crate::offscreen::Offscreen;
use crate::skinned::Playing;
use crate::written::Written;
use deltamorph::after::{SkinDesc, SkinMethod, SkinTarget};
use deltamorph::ash::vk;
use deltamorph::import::gltf::{self, Animation, Channel, Gltf, Influences, Property};
use deltamorph::reference::{self, compare, evaluate_unpacked};
use deltamorph::{
    BatchSize, Consumers, CrowdDesc, DeltaFormat, MorphMesh, PoseFormat, Semantic, Tolerance, UpdateDesc, UpdatePath,
};
use deltamorph_headless::{Headless, HeadlessCrowd};
use glam::{DMat4, DQuat, DVec3};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

fn write(character: &Character, folder: &Path) -> PathBuf {
    let path = folder.join("character.glb");
    std::fs::write(&path, character.write().glb()).unwrap();
    path
}

/// Returns joints in the layout of the skinning step.
fn packed_joints(matrices: &[DMat4], method: SkinMethod) -> Vec<f32> {
    let rows = |m: &DMat4| m.transpose().to_cols_array()[..12].iter().map(|x| *x as f32).collect::<Vec<f32>>();
    let quaternions = |m: &DMat4| {
        let (_, rotation, t) = m.to_scale_rotation_translation();
        let dual = DQuat::from_xyzw(t.x, t.y, t.z, 0.0) * rotation * 0.5;
        [rotation, dual].iter().flat_map(|q| q.to_array().map(|x| x as f32)).collect::<Vec<f32>>()
    };
    match method {
        SkinMethod::DualQuaternion => matrices.iter().flat_map(quaternions).collect(),
        _ => matrices.iter().flat_map(rows).collect(),
    }
}

/// Returns weights and joint matrices from the reader, of the node that draws the mesh.
fn at(gltf: &Gltf, playing: Playing) -> (Vec<f32>, Vec<DMat4>) {
    let playing = playing.map(|(clip, time)| (&gltf.animations[clip], time));
    let number = gltf.nodes.iter().position(|node| node.skin.is_some()).expect("a node with a skin");
    let node = &gltf.nodes[number];
    let channel = |(animation, time): (&Animation, f64)| {
        let of_node = |c: &&Channel| (c.node, c.property) == (number, Property::Weights);
        let channel = animation.channels.iter().find(of_node)?;
        Some(channel.sample(time).into_iter().map(|w| w as f32).collect())
    };
    let rest = if node.weights.is_empty() { &gltf.meshes[node.mesh.unwrap()].weights } else { &node.weights };
    let weights: Vec<f32> = playing.and_then(channel).unwrap_or_else(|| rest.clone());
    (weights, gltf.joint_matrices(&gltf.skins[node.skin.unwrap()], &gltf.world_matrices(playing)))
}

/// Returns the matrix that a vertex follows.
fn blend(influences: &Influences, v: usize, matrices: &[DMat4]) -> DMat4 {
    let n = influences.per_vertex;
    let joints = influences.joints[v * n..].iter().zip(&influences.weights[v * n..]).take(n);
    joints.map(|(joint, weight)| matrices[usize::from(*joint)] * f64::from(*weight)).sum()
}

/// Returns positions from the reader, skinned without a device.
fn positions(gltf: &Gltf, mesh: &MorphMesh, playing: Playing) -> Vec<DVec3> {
    let (weights, matrices) = at(gltf, playing);
    let influences = gltf.meshes[0].influences.as_ref().expect("a skin");
    let (joints, per_vertex) = (matrices.len() as u32, influences.per_vertex as u32);
    let desc = SkinDesc::new(per_vertex, joints, &influences.joints, &influences.weights);
    let joints = packed_joints(&matrices, SkinMethod::Linear);
    let pose = evaluate_unpacked(mesh, &weights);
    let pose = reference::skin(&pose, &desc, SkinMethod::Linear, &joints).expect("a skinned pose");
    pose.chunks_exact(6).map(DVec3::from_slice).collect()
}

/// Returns the rest pose, and moments before, at, between and after the keys of each clip.
fn moments() -> Vec<Playing> {
    let times = [0.0, 0.25, 0.4, 0.5, 0.9, 1.3, 1.5, 2.0];
    let clips = (0..3).flat_map(|clip| times.map(|time| Some((clip, time))));
    std::iter::once(None).chain(clips).collect()
}

/// Largest distance relative to the diagonal, degrees between normals, degrees between tangents.
type Off = (f64, f64, f64);

/// Plays all clips of a character on the device: with the mesh of the file, or the merged mesh.
fn play(
    headless: &Headless,
    character: &Character,
    format: DeltaFormat,
    update: UpdateDesc,
    method: SkinMethod,
    is_merged: bool,
) -> Off {
    let host = Offscreen::new(headless, 1, vk::Format::R8G8B8A8_UNORM).expect("buffers");
    let folder = tempfile::tempdir().unwrap();
    let gltf = gltf::read(&write(character, folder.path())).unwrap();
    let (merged, skeleton) = gltf.clone().into_skinned().expect("a mesh");
    let skeleton = skeleton.expect("a skin");
    let (source, influences, joint_count) = match is_merged {
        true => (&merged, &skeleton.influences, skeleton.joint_count() as u32),
        false => (&gltf.meshes[0].source, gltf.meshes[0].influences.as_ref().expect("a skin"), 4),
    };
    let packed = gpu::packed(headless.engine(), &source.to_mesh(Tolerance::ZERO).expect("a mesh"), format);
    let desc = SkinDesc::new(influences.per_vertex as u32, joint_count, &influences.joints, &influences.weights);
    // SAFETY: the buffer is recording, runs once, and is waited for.
    let mut skin = headless.run(|cmd| unsafe { headless.engine().upload_skin(cmd, &packed, &desc) }).expect("a skin");
    // SAFETY: it has run.
    unsafe { skin.release_staging() };
    let desc = CrowdDesc::new(update).consumers(Consumers::VERTEX_ATTRIBUTES | Consumers::COPIES);
    let mut crowd = HeadlessCrowd::new(headless, &packed, &desc).expect("a crowd");
    let layout = packed.layout();
    let mut joints = Joints::new(headless, &host, method, 1.0);
    let output = Written::new(headless, &host, layout.vertex_count, (0, 24, Some(12)));
    let target = SkinTarget::new(output.buffer, joints.shared.buffer, 3 * Joints::STRIDE).method(method);
    let target = target.joints_offset(joints.offset());
    // SAFETY: the buffers are large enough, and live as long as the crowd; nothing is running.
    unsafe { crowd.set_skin_target(0, Some((&skin, &target))) }.expect("a target");
    let tangents = packed.groups().iter().position(|group| group.layout().streams[0].semantic == Semantic::Tangent);
    let by_dual_quaternions = method == SkinMethod::DualQuaternion;
    let mut held = vec![f32::NAN; layout.padded_vertices() * 6];
    let mut worst: Off = (0.0, 0.0, 0.0);
    for playing in moments() {
        let (weights, mut matrices) = at(&gltf, playing);
        if is_merged {
            matrices = skeleton.joint_matrices(playing.map(|(clip, time)| (&skeleton.animations[clip], time)));
        }
        joints.set(headless, packed_joints(&matrices, method));
        crowd.set_joints(0, joints.offset()).expect("joints");
        crowd.step(&[&weights]).expect("a step");
        for (v, words) in output.take(headless).into_iter().enumerate() {
            let words = words.expect("joints moved: each vertex is written");
            held[6 * v..][..6].iter_mut().zip(words).for_each(|(held, word)| *held = f32::from_bits(word));
        }
        let expected = character.pose(playing, by_dual_quaternions);
        let error = compare(&layout.to_user_order(&held), &expected.surface);
        let ends = expected.surface.chunks_exact(6).map(|v| DVec3::from_slice(v));
        let [low, high] = [ends.clone().reduce(DVec3::min), ends.reduce(DVec3::max)].map(Option::unwrap);
        let (morphed, _) = crowd.read_group(0, tangents.expect("tangents")).expect("a pose");
        // The merged mesh is elsewhere before its joints move it.
        let at = |v: usize| match is_merged {
            true => (blend(influences, v, &matrices), expected.skinned_tangents[v]),
            false => (DMat4::IDENTITY, expected.tangents[v]),
        };
        let degrees = morphed.chunks_exact(6).enumerate().map(|(v, found)| {
            let (matrix, expected) = at(v);
            let found = matrix.transform_vector3(glam::Vec3::from_slice(found).as_dvec3()).normalize();
            let expected = DVec3::from_array(expected);
            found.cross(expected).length().atan2(found.dot(expected)).to_degrees()
        });
        let tangents = degrees.fold(0.0, f64::max);
        let position = error.position / (high - low).length();
        worst = (worst.0.max(position), worst.1.max(error.normal_degrees), worst.2.max(tangents));
        assert!(worst.0 < 1e-2, "{:?} {format:?} {method:?} {playing:?}: {worst:?}", character.stored);
    }
    worst
}

#[test]
fn a_skinned_morphing_character_is_what_its_file_says() {
    const EXT: Stored = Stored::Compressed("EXT_meshopt_compression", 0);
    const KHR: Stored = Stored::Compressed("KHR_meshopt_compression", 1);
    gpu::on_every_device(|headless, _| {
        let exact = UpdateDesc::blocks();
        let dense = UpdateDesc::new(UpdatePath::Compute, BatchSize::Targets(2));
        let (linear, dual) = (SkinMethod::Linear, SkinMethod::DualQuaternion);
        // Positions as a fraction of the diagonal, and degrees. They include packing errors: `fast` has 9 bits per
        // component of normals, whose sums are short here.
        let (all, fast) = ((2e-6, 0.01, 0.01), (5e-5, 3.0, 3.0));
        for (stored, influences, method, format, update, limits, is_merged) in [
            (Stored::Floats, 4, linear, DeltaFormat::Float32, dense, all, false),
            (Stored::Floats, 8, linear, DeltaFormat::BlockFloat32, exact, all, false),
            (Stored::Floats, 4, dual, DeltaFormat::BlockFloat32, exact, all, false),
            (Stored::Floats, 8, dual, DeltaFormat::Float32, dense, all, false),
            (Stored::Floats, 4, linear, DeltaFormat::Fast, exact.pose(PoseFormat::Fixed32), fast, false),
            (Stored::Quantised, 4, linear, DeltaFormat::BlockFloat32, exact, all, false),
            (EXT, 8, linear, DeltaFormat::Float32, dense, all, false),
            (KHR, 4, linear, DeltaFormat::BlockFloat32, exact, all, false),
            (Stored::Floats, 8, linear, DeltaFormat::BlockFloat32, exact, all, true),
            (Stored::Quantised, 4, linear, DeltaFormat::Float32, dense, all, true),
        ] {
            let character = Character::new(stored, influences, method == dual);
            let off = play(headless, &character, format, update, method, is_merged);
            let what = format!("{}: {stored:?}, {influences}, {method:?}, {format:?}", headless.caps().name);
            println!("{what}: off by {:.1e} of the diagonal, {:.1e} and {:.1e} degrees", off.0, off.1, off.2);
            assert!(off.0 < limits.0 && off.1 < limits.1 && off.2 < limits.2, "{what}: {off:?}");
        }
    });
}

/// Without joints, the one mesh of the file has them at rest.
#[test]
fn a_character_at_rest_is_what_its_file_says() {
    let folder = tempfile::tempdir().unwrap();
    let compressed = Stored::Compressed("EXT_meshopt_compression", 0);
    for (stored, influences) in [(Stored::Floats, 8), (Stored::Quantised, 4), (compressed, 8)] {
        let character = Character::new(stored, influences, false);
        let source = gltf::read(&write(&character, folder.path())).unwrap().into_source().expect("a mesh");
        let mesh = source.to_mesh(Tolerance::ZERO).expect("a mesh");
        let pose: Vec<f32> =
            evaluate_unpacked(&mesh, &character.node_weights).iter().map(|number| *number as f32).collect();
        let off = compare(&pose, &character.pose(None, false).surface);
        let position = off.position / f64::from(mesh.diagonal);
        println!("{stored:?}, {influences}: off by {position:.1e} of the diagonal, {:.1e} degrees", off.normal_degrees);
        assert!(position < 1e-6 && off.normal_degrees < 1e-3, "{stored:?}: {off:?}");
    }
}

/// Characters processed by gltf-transform: joints, targets and clips are the same, vertices are quantised, compressed,
/// and reordered. `DELTAMORPH_GLTF_TOOLS` names the folder in which `npm install @gltf-transform/cli` was run.
#[test]
fn what_tools_make_of_a_character_is_the_same_character() {
    let Some(tools) = std::env::var_os("DELTAMORPH_GLTF_TOOLS").map(PathBuf::from) else {
        std::io::stderr().write_all(b"LEFT OUT: DELTAMORPH_GLTF_TOOLS names no folder of npm packages\n").unwrap();
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("made.glb");
    // Largest errors as fractions of the diagonal: quantised positions have 14 bits, joint weights 8.
    let (exact, quantised) = (1e-6, 5e-3);
    for (arguments, limit) in [
        ("copy", exact),
        ("sparse", exact),
        ("quantize", quantised),
        ("meshopt --level medium", quantised),
        ("meshopt --level high", 2.0 * quantised), // animations are quantised, too
    ] {
        let character = Character::new(Stored::Floats, 8, false);
        let input = write(&character, folder.path());
        let (what, mut arguments) = (format!("gltf-transform {arguments}"), arguments.split(' '));
        let mut command = Command::new(tools.join("node_modules/.bin").join("gltf-transform"));
        command.args(arguments.next()).arg(&input).arg(&output).args(arguments);
        let ran = command.output().expect("a tool that runs");
        assert!(ran.status.success(), "{what}: {}", String::from_utf8_lossy(&ran.stderr));
        let gltf = gltf::read(&output).unwrap_or_else(|e| panic!("{what}: {e}"));
        let mesh = gltf.meshes[0].source.to_mesh(Tolerance::ZERO).expect("a mesh");
        let expected = |playing| -> Vec<DVec3> {
            character.pose(playing, false).surface.chunks_exact(6).map(DVec3::from_slice).collect()
        };
        let rest = expected(None);
        let [low, high] = [DVec3::min, DVec3::max].map(|f| rest.iter().copied().reduce(f).unwrap());
        let diagonal = (high - low).length();
        let nearest = |p: &DVec3| (0..rest.len()).min_by(|a, b| p.distance(rest[*a]).total_cmp(&p.distance(rest[*b])));
        let order: Vec<usize> = positions(&gltf, &mesh, None).iter().map(|p| nearest(p).unwrap()).collect();
        let mut found = order.clone();
        found.sort_unstable();
        found.dedup();
        assert_eq!(found.len(), rest.len(), "{what}: each vertex is there");
        let mut worst = 0.0f64;
        for playing in moments() {
            let expected = expected(playing);
            let found = positions(&gltf, &mesh, playing);
            let off = found.iter().zip(&order).map(|(p, v)| p.distance(expected[*v])).fold(0.0, f64::max) / diagonal;
            worst = worst.max(off);
        }
        println!("{what}: off by {worst:.1e} of the diagonal");
        assert!(worst < limit, "{what}: {worst:e}");
    }
}
