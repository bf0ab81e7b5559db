//! 16-bit poses: distance from float64 on captured clips, memory, largest weights, and unusual meshes.

use crate::prelude::*;
use deltamorph::mesh::KeptTarget;
use deltamorph::reference::angle_degrees;
use glam::DVec3;

fn on_cpu(pose: PoseFormat) -> UpdateDesc {
    UpdateDesc { path: UpdatePath::Cpu, pose, ..UpdateDesc::blocks() }
}

/// Returns, for every `every`-th frame of a clip, the largest position error against the requested weights, as a
/// fraction of the diagonal, and the normal error in degrees of 99 in 100 vertices. Asserts the stated bound, and
/// returns the largest, too, as a fraction of the diagonal.
fn errors(pose: PoseFormat, (set, clip, every): (&str, &str, usize)) -> Option<[f64; 3]> {
    let (mesh, frames) = data::face(set, clip)?;
    let packed = Arc::new(PackedMesh::pack(&mesh, &PackDesc::new(DeltaFormat::Small)).expect("a mesh that packs"));
    let desc = on_cpu(pose);
    let grid = desc.grid(packed.layout()).expect("a grid").expect("integers");
    let mut crowd = CpuCrowd::new(packed.clone(), &CrowdDesc::new(desc), 2).expect("a crowd");
    let (mut worst, mut share, mut largest_bound, mut angles) = (0.0f64, 0.0f64, 0.0f64, vec![]);
    for weights in frames.into_iter().step_by(every) {
        crowd.set_weights(0, &weights).expect("weights");
        let bound = f64::from(crowd.update().bound);
        largest_bound = largest_bound.max(bound);
        let pose = packed.layout().to_user_order(&crowd.pose(0).expect("a pose"));
        let rounded: Vec<f32> = weights.iter().map(|w| grid.round(*w)).collect();
        assert!(bound <= f64::from(grid.position_error(weights.iter().filter(|w| **w != 0.0).count())));
        let (requested, rounded) = (evaluate(&packed, &weights), evaluate(&packed, &rounded));
        let vertices = pose.as_chunks::<6>().0.iter().zip(requested.as_chunks::<6>().0).zip(rounded.as_chunks::<6>().0);
        for ((pose, requested), rounded) in vertices {
            let vector = |v: &[f64; 6], from: usize| DVec3::from_slice(&v[from..]);
            let pose = pose.map(f64::from);
            worst = worst.max(vector(&pose, 0).distance(vector(requested, 0)));
            // Decoding rounds once, at the magnitude of the pose.
            let float = vector(rounded, 0).length() * f64::from(f32::EPSILON);
            let error = vector(&pose, 0).distance(vector(rounded, 0));
            assert!(error <= bound + float, "{set}: {error:e}, {bound:e} allowed");
            share = share.max((error - float) / bound.max(f64::MIN_POSITIVE));
            angles.push(angle_degrees(vector(&pose, 3), vector(requested, 3)));
        }
    }
    let at = angles.len() * 99 / 100;
    let (_, normal, _) = angles.select_nth_unstable_by(at, f64::total_cmp);
    let [position, bound] = [worst, largest_bound].map(|length| length / f64::from(mesh.diagonal));
    let normal = *normal;
    let largest = angles.iter().copied().fold(0.0, f64::max);
    println!(
        "{set} {}: position {position:.2e} of the diagonal, {:.0}% of the bound; normal {normal:.3}° of 99%, at most \
         {largest:.2}°",
        desc.pose.name(),
        share * 100.0
    );
    Some([position, normal, bound])
}

#[test]
fn captured_clips_stay_within_a_five_thousandth_of_the_diagonal_and_a_third_of_a_degree() {
    for (set, clip, every) in [
        ("ict_facekit", "facecap_30fps.csv", 20),
        ("ict_facekit", "facegood_2_01_mapped_30fps.csv", 60),
        ("makehuman_face", "facecap_30fps.csv", 20),
        ("facecap_head_glb", "facecap_30fps.csv", 20),
    ] {
        let Some([position, normal, _]) = errors(PoseFormat::Fixed16, (set, clip, every)) else { continue };
        assert!(position <= 2e-4 && normal <= 0.3, "{set}/{clip}: {position:e}, {normal}°");
    }
}

/// 267 overlapping targets: rounding the term of each shows, and rounding their sum does not.
#[test]
fn a_dense_rig_is_as_exact_where_sums_are_rounded_once() {
    let clip = ("aura_rebuilt", "compskin_30fps.csv", 80);
    let Some([position, ..]) = errors(PoseFormat::Fixed16, clip) else { return };
    assert!(position > 1e-4, "fixed16 would do: {position:e}");
    let [position, normal, bound] = errors(PoseFormat::Rebuilt16, clip).expect("the same set");
    assert!(position <= 8.7e-5 && normal <= 0.3, "{position:e}, {normal}°");
    assert!(bound <= 10.0 * position, "{bound:e} stated, {position:e} found");
}

/// Two slots of 12 bytes per vertex for each instance; besides them, only lists grow with vertices.
#[test]
fn a_crowd_takes_24_bytes_a_vertex_for_two_slots() {
    const HEADS: u32 = 100;
    let mut mesh = testing::mesh(6400, 1);
    mesh.targets[0] = one_vertex(&mesh, "target_0", 5);
    gpu::on_every_device(|headless, engine| {
        let mesh = gpu::packed(engine, &mesh, DeltaFormat::Fast);
        let vertices = u64::from(HEADS) * 6400;
        let made = |pose| {
            let desc = CrowdDesc {
                instances: HEADS,
                frames_in_flight: 1,
                ..CrowdDesc::new(UpdateDesc { pose, ..UpdateDesc::blocks() })
            };
            let mut crowd = HeadlessCrowd::new(headless, &mesh, &desc).expect("a crowd");
            crowd.step(&[]).expect("a step");
            let view = crowd.crowd().pose(HEADS - 1).expect("a pose");
            assert_eq!((u64::from(view.stride), view.size), (pose.stride() as u64, 6400 * pose.stride() as u64));
            // Memory of the crowd, with a base pose in its format; and of the mesh, which has three numbers of 8 bytes
            // per vertex, once.
            (engine.memory().allocated, Crowd::pose_bytes(&mesh, &desc))
        };
        let (of_16, poses_of_16) = made(PoseFormat::Fixed16);
        let (of_32, poses_of_32) = made(PoseFormat::Fixed32);
        assert_eq!((poses_of_16, poses_of_32), (24 * vertices, 48 * vertices));
        assert_eq!(of_32 - of_16, 24 * vertices + 12 * 6400, "poses and their base are all that differs");
        let rest = (of_16 - poses_of_16) as f64 / vertices as f64;
        assert!(rest < 6.0, "{}: {rest} bytes a vertex beside the poses", headless.caps().name);
    });
}

/// Makes a target that moves one vertex, in all three components.
fn one_vertex(mesh: &KeptMesh, name: &str, vertex: u32) -> KeptTarget {
    let part = |v: glam::Vec3| vec![v * 0.25 + 0.01];
    let (position, normal) = (mesh.positions[vertex as usize], mesh.normals[vertex as usize]);
    KeptTarget {
        name: name.into(),
        vertices: vec![vertex],
        positions: part(position),
        normals: part(normal),
        ..KeptTarget::default()
    }
}
