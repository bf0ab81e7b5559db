//! 16-bit poses: distance from float64 on captured clips.

use crate::prelude::*;
use deltamorph::reference::angle_degrees;
use glam::DVec3;

/// Returns, for every `every`-th frame of a clip, the largest position error against the requested weights, as a
/// fraction of the diagonal, and the normal error in degrees of 99 in 100 vertices. Asserts the stated bound, and
/// returns the largest, too, as a fraction of the diagonal.
fn errors(pose: PoseFormat, (set, clip, every): (&str, &str, usize)) -> Option<[f64; 3]> {
    let (mesh, frames) = data::face(set, clip)?;
    let packed = Arc::new(PackedMesh::pack(&mesh, &PackDesc::new(DeltaFormat::Small)).expect("a mesh that packs"));
    let desc = UpdateDesc { pose, ..UpdateDesc::blocks() };
    let grid = desc.grid(packed.layout()).expect("a grid").expect("integers");
    let mut crowd = gpu::cpu_crowd(&packed, desc, 1);
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
