use super::*;
use crate::pack::{DeltaFormat, PackDesc};
use crate::testing;
use proptest::prelude::*;

fn mesh() -> KeptMesh {
    testing::mesh(120, 9)
}

fn ranked_with(pins: &[&str]) -> Result<Importance> {
    Importance::of_packed(&PackedMesh::pack(&mesh(), &PackDesc::default())?, pins)
}

/// The largest distance between what two lists of weights make of any vertex, in double precision.
fn distance(mesh: &KeptMesh, a: &[f32], b: &[f32]) -> f64 {
    let mut moved = vec![DVec3::ZERO; mesh.vertex_count()];
    for (target, (a, b)) in mesh.targets.iter().zip(a.iter().zip(b)) {
        let by = f64::from(*a) - f64::from(*b);
        target.vertices.iter().zip(&target.positions).for_each(|(&v, d)| moved[v as usize] += d.as_dvec3() * by);
    }
    moved.iter().map(|d| d.length()).fold(0.0, f64::max)
}

fn at_level(importance: &Importance, level: f32, weights: &[f32]) -> Vec<f32> {
    let mut weights = weights.to_vec();
    importance.apply(level, &mut weights).unwrap();
    weights
}

proptest! {
    /// For any weights, what is dropped moves no vertex further than is said; and the levels that follow a camera move
    /// none further from one frame to the next than the fade, whatever it does, and end where the pixels are kept.
    #[test]
    fn errors_and_fades_are_bounds(
        kept in 0usize..=9, seed in any::<u32>(), pixels in 0.1f32..50.0, fade in 0.05f32..3.0,
        camera in prop::collection::vec(0.01f32..100.0, 1..12), with_weights in any::<bool>(),
    ) {
        let (mesh, importance) = (mesh(), ranked_with(&[]).unwrap());
        let weight = |t: u32| match (seed ^ (t + 1).wrapping_mul(0x9E37_79B9)).wrapping_mul(0xC2B2_AE35) >> 16 {
            x if x % 4 == 0 => 0.0,
            x => (x % 2001) as f32 / 1000.0 - 1.0,
        };
        let weights: Vec<f32> = (0..9).map(weight).collect();
        let dropped = at_level(&importance, kept as f32, &weights);
        prop_assert!(distance(&mesh, &weights, &dropped) <= f64::from(importance.errors[kept]));

        let mut level = Level::new(pixels);
        level.fade = fade;
        let mut shown: Option<Vec<f32>> = None;
        let given = with_weights.then_some(&weights[..]);
        for pixels_per_unit in camera.iter().flat_map(|c| [c; 3]) {
            let now = at_level(&importance, level.step(&importance, *pixels_per_unit, given), &weights);
            if let Some(before) = shown.replace(now.clone()) {
                let moved = distance(&mesh, &before, &now) * f64::from(*pixels_per_unit);
                prop_assert!(moved <= f64::from(fade) * 1.0001 + 1e-4, "{moved} pixels, {fade} allowed");
            }
        }
        let last = *camera.last().unwrap();
        let settled = (0..10_000).any(|_| level.step(&importance, last, given) == level.goal as f32);
        // Fades are at least 0.05 pixels of some 10,000 in all.
        if settled {
            let off = distance(&mesh, &weights, &at_level(&importance, level.goal as f32, &weights));
            prop_assert!(off * f64::from(last) <= f64::from(pixels / 2.0) * 1.0001);
        }
    }
}

#[test]
fn the_fade_arrives_in_as_many_frames_as_it_takes() {
    let importance = ranked_with(&[]).unwrap();
    let mut level = Level::new(1.0);
    level.fade = 0.5;
    assert_eq!(level.step(&importance, 0.0, None), 0.0, "what is not seen needs nothing");
    let (near, whole) = (50.0, (0..9).map(|t| importance.reach(t)).sum::<f32>() * 50.0);
    let frames = (1..100_000).find(|_| level.step(&importance, near, None) == 8.0).unwrap();
    assert!((frames as f32 - whole / 0.5).abs() < 2.0 + 1e-3 * frames as f32, "{frames} frames for {whole} pixels");
    // Targets without a weight come and go at no cost; a reset takes no frames.
    assert_eq!(level.step(&importance, 0.0, Some(&[0.0; 9])), 0.0);
    level.reset();
    assert_eq!(level.step(&importance, near, None), 8.0, "the last one moves nothing");
    assert_eq!(level.step(&importance, f32::INFINITY, None), 9.0, "a camera in the head");
    assert_eq!(level.step(&importance, f32::NAN, None), 9.0);
}

/// A camera that trembles by a tenth changes nothing after its first move.
#[test]
fn a_camera_that_trembles_changes_no_level() {
    let importance = ranked_with(&[]).unwrap();
    for at in (1..60).map(|i| 0.02 * i as f32) {
        let mut level = Level::new(4.0);
        level.fade = f32::INFINITY;
        [at, at * 0.9, at * 1.1].iter().for_each(|&p| _ = level.step(&importance, p, None));
        let settled = level.step(&importance, at * 0.95, None);
        let trembling = [1.1, 0.9, 1.0, 0.95, 1.05, 0.9, 1.1].map(|by| level.step(&importance, at * by, None));
        assert_eq!(trembling, [settled; 7], "{at} pixels a unit");
    }
}

#[test]
fn orders_are_those_of_the_mean_square_with_pins_in_front() {
    let mesh = mesh();
    let importance = ranked_with(&[]).unwrap();
    let score = |target: &u32| mean_square(&mesh, &mesh.targets[*target as usize]);
    assert!(importance.order().windows(2).all(|two| score(&two[0]) >= score(&two[1])));
    assert!(importance.order().iter().enumerate().all(|(rank, t)| importance.ranks()[*t as usize] == rank as u32));
    assert_eq!(importance.order().last(), Some(&2), "it moves nothing");
    let errors = &importance.errors;
    assert!(errors.windows(2).all(|two| two[0] >= two[1]) && errors[8..] == [0.0; 2] && errors[7] > 0.0);
    // The fewest that fit.
    for pixels in errors.iter().map(|error| error * 3.0) {
        let kept = importance.level_for(3.0, pixels);
        assert!(errors[kept] * 3.0 <= pixels && (kept == 0 || errors[kept - 1] * 3.0 > pixels));
    }
    let pinned = ranked_with(&["target_2", "target_5"]).unwrap();
    assert_eq!((&pinned.order()[..2], pinned.level_for(1.0, f32::MAX)), (&[5, 2][..], 2));
    let packed = PackedMesh::pack(&mesh, &PackDesc::default()).unwrap();
    let names: Vec<&str> = pinned.order().iter().map(|t| mesh.targets[*t as usize].name.as_str()).collect();
    assert_eq!(Importance::in_order(&packed, &names, 2).unwrap(), pinned);
}

#[test]
fn factors_fade_the_last_target_and_leave_whole_weights_alone() {
    let importance = ranked_with(&[]).unwrap();
    let weights = [0.1, -0.7, 1.0 / 3.0, 0.2, 5.0, -0.0, 0.9, 0.3, 0.6];
    let bits = |weights: &[f32]| weights.iter().map(|weight| weight.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&at_level(&importance, 9.0, &weights)), bits(&weights));
    let faded = at_level(&importance, 3.25, &weights);
    for (t, (faded, weight)) in faded.iter().zip(&weights).enumerate() {
        let expected = [1.0, 1.0, 1.0, 0.25].get(importance.ranks()[t] as usize).map_or(0.0, |f| weight * f);
        assert!(*faded == expected && importance.factor(t, 3.25) * weight == expected, "target {t}: {faded}");
    }
    assert_eq!(Level::new(3.0).error_budget(50.0), 0.03);
    assert_eq!(Level::new(1.0).error_budget(0.0), 0.0);
    assert!((pixels_per_unit(1000.0, std::f32::consts::FRAC_PI_2, 4.0) - 125.0).abs() < 1e-3);
}

#[test]
fn what_cannot_be_ranked_is_refused() {
    let mesh = mesh();
    let packed = PackedMesh::pack(&mesh, &PackDesc::new(DeltaFormat::Fast)).unwrap();
    let names: Vec<&str> = mesh.targets.iter().map(|target| target.name.as_str()).collect();
    let [mut twice, mut other] = [names.clone(), names.clone()];
    (twice[3], other[3]) = ("target_4", "Target_3");
    for (result, words) in [
        (ranked_with(&["jaw"]), "no target of mesh 'test_120x9' has a name that begins with 'jaw'"),
        (Importance::in_order(&packed, &twice, 0), "names 'target_4' twice; name each target once"),
        (Importance::in_order(&packed, &other, 0), "use 'target_3' if that is meant"),
        (Importance::in_order(&packed, &names[1..], 0), "of 8 targets, 0 of them pinned"),
        (Importance::in_order(&packed, &names, 10), "name all of its 9 targets, and pin no more"),
    ] {
        testing::says(result, &[words]);
    }
    let text = ranked_with(&[]).unwrap().apply(1.0, &mut [0.0; 3]).unwrap_err().to_string();
    assert!(text.contains("3 weights given, but 9 targets are ranked"), "{text}");
}
