//! Normalised blending on the device: poses of absolute-pose weights equal A. Gerdelan's formula, in float64.

use super::table::{can_read, updates};
use crate::gpu::{on_every_device, packed};
use crate::testing;
use deltamorph::{CrowdDesc, DeltaFormat, MorphMesh, POSE_FLOATS, UpdatePath, normalise_weights};
use deltamorph_head::Rng;
use deltamorph_headless::HeadlessCrowd;

/// Returns base and targets as whole meshes, as in the OBJ files of a folder: position and normal of each vertex.
fn whole_meshes(mesh: &MorphMesh) -> Vec<Vec<f64>> {
    let numbers = |(p, n): (&deltamorph::glam::Vec3, &deltamorph::glam::Vec3)| {
        let [p, n] = [p.as_dvec3().to_array(), n.as_dvec3().to_array()];
        p.into_iter().chain(n)
    };
    let base: Vec<f64> = mesh.positions.iter().zip(&mesh.normals).flat_map(numbers).collect();
    let target = |target: &deltamorph::mesh::MorphTarget| {
        let mut whole = base.clone();
        let deltas = target.positions.iter().zip(&target.normals).map(numbers);
        for (v, delta) in target.vertices.iter().zip(deltas) {
            whole[*v as usize * POSE_FLOATS..].iter_mut().zip(delta).for_each(|(number, delta)| *number += delta);
        }
        whole
    };
    std::iter::once(base.clone()).chain(mesh.targets.iter().map(target)).collect()
}

/// Returns (w₀ base + Σ wᵢ poseᵢ) / (w₀ + Σ wᵢ), where w₀ is 1 − Σ wᵢ, or at least 0 for `text`, as in his text.
fn gerdelan(meshes: &[Vec<f64>], weights: &[f32], text: bool) -> Vec<f64> {
    let sum: f64 = weights.iter().map(|w| f64::from(*w)).sum();
    let of_base = if text { (1.0 - sum).clamp(0.0, 1.0) } else { 1.0 - sum };
    let factors: Vec<f64> = std::iter::once(of_base).chain(weights.iter().map(|w| f64::from(*w))).collect();
    let all: f64 = factors.iter().sum();
    let at = |i: usize| meshes.iter().zip(&factors).map(|(mesh, factor)| mesh[i] * factor).sum::<f64>() / all;
    (0..meshes[0].len()).map(at).collect()
}

fn apart(a: &[f32], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max)
}

#[test]
fn poses_are_those_of_gerdelans_formula_in_both_readings() {
    const TARGETS: usize = 9;
    let mesh = testing::mesh(200, TARGETS);
    let meshes = whole_meshes(&mesh);
    on_every_device(|headless, engine| {
        let (mut worst, mut between, mut above) = (0.0f64, f64::INFINITY, 0);
        for format in [DeltaFormat::Float32, DeltaFormat::BlockFloat32] {
            let mesh = packed(engine, &mesh, format);
            // One update per path, since every batch size adds the same numbers.
            let mut updates = updates(engine, format);
            updates.dedup_by_key(|update| update.path);
            // Its draws take few targets at a time.
            updates.retain(|update| can_read(headless, update) && update.path != UpdatePath::DirectAttributes);
            for update in updates {
                let name = update.path.name();
                let mut crowd =
                    HeadlessCrowd::new(headless, &mesh, &CrowdDesc::new(update.tolerance(1e-6))).expect("a crowd");
                let mut rng = Rng::new(15, 4);
                for frame in 0..6 {
                    // Sums below one, and up to 4.
                    let most = [0.15, 0.9][frame % 2];
                    let weights: Vec<f32> = (0..TARGETS).map(|_| rng.range(0.0, most)).collect();
                    for text in [true, false] {
                        let mut factors = weights.clone();
                        if text {
                            normalise_weights(&mut factors);
                        }
                        crowd.step(&[&factors]).expect("an update");
                        let pose = crowd.read_pose(0).expect("a pose");
                        let off = apart(&pose, &gerdelan(&meshes, &weights, text));
                        assert!(off < 2e-5, "{name}, frame {frame}, text {text}: off by {off}");
                        worst = worst.max(off);
                        if frame % 2 == 1 {
                            assert!(weights.iter().sum::<f32>() > 1.2, "{weights:?}");
                            between = between.min(apart(&pose, &gerdelan(&meshes, &weights, !text)));
                            above += 1;
                        }
                    }
                }
            }
        }
        println!("{}: off by {worst:e}; readings are {between} apart or more", headless.caps().name);
        assert!(above >= 12 && between > 1e-3, "readings differ by {between} only");
    });
}
