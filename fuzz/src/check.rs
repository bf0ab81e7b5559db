//! Checks for any mesh that was read: it packs or is refused, and its poses agree with the float64 reference.

use deltamorph::reference::{compare, evaluate};
use deltamorph::{
    BatchSize, CpuCrowd, CrowdDesc, DeltaFormat, Error, KeptMesh, PackDesc, PackedMesh, PoseFormat, UpdateDesc,
    UpdatePath,
};
use std::sync::Arc;

/// Checks that an error has a message, whatever the input contains.
pub fn check_error(error: Error) {
    let text = error.to_string();
    assert!(text.len() > 10 && !text.contains('\0'), "an error without words: {text:?}");
}

/// Packs a mesh in the format that `choice` selects, and compares poses of it with the reference.
pub fn pack_and_update(mesh: &KeptMesh, choice: u32) {
    for target in &mesh.targets {
        assert!(target.vertices.is_sorted_by(|a, b| a < b), "vertices of a target ascend");
        assert!(
            target.vertices.iter().all(|v| (*v as usize) < mesh.vertex_count()),
            "a target moves vertices that are there"
        );
        assert!(target.positions.iter().chain(&target.normals).all(|d| d.is_finite()), "deltas are finite");
    }
    // Larger meshes take time and exercise nothing new.
    if mesh.vertex_count() > 2000 || mesh.targets.len() > 64 {
        return;
    }
    let format = DeltaFormat::ALL[choice as usize % DeltaFormat::ALL.len()];
    match PackedMesh::pack(mesh, &PackDesc::new(format)) {
        Ok(packed) => update(&Arc::new(packed), choice / 8),
        Err(error) => check_error(error),
    }
}

/// Updates an instance of a packed mesh three times, with poses in the format that `choice` selects, and otherwise in
/// float32. The error of a pose is at most what its update states, plus the rounding of sums.
pub fn update(mesh: &Arc<PackedMesh>, choice: u32) {
    let desc = UpdateDesc::new(UpdatePath::Cpu, BatchSize::All);
    let picked = UpdateDesc { pose: PoseFormat::ALL[choice as usize % PoseFormat::ALL.len()], ..desc };
    let new = |desc| Some((CpuCrowd::new(mesh.clone(), &CrowdDesc::new(desc), 1).map_err(check_error).ok()?, desc));
    let Some((mut crowd, desc)) = new(picked).or_else(|| new(desc)) else { return };
    let layout = mesh.layout();
    let grid = desc.grid(layout).expect("there is a crowd");
    for frame in 0..3u32 {
        let weight = |t: u32| match (choice ^ (t * 77 + frame * 13)).wrapping_mul(2_654_435_761) >> 16 {
            x if x % 3 == 0 => 0.0,
            x => (x % 1000) as f32 / 500.0 - 1.0,
        };
        let weights: Vec<f32> = (0..layout.targets.len() as u32).map(weight).collect();
        if let Err(error) = crowd.set_weights(0, &weights) {
            check_error(error);
            continue;
        }
        let bound = f64::from(crowd.update().bound);
        let weights: Vec<f32> = weights.iter().map(|w| grid.map_or(*w, |grid| grid.round(*w))).collect();
        let pose = layout.to_user_order(&crowd.pose(0).expect("an instance"));
        let (base, reference) = (evaluate(mesh, &[]), evaluate(mesh, &weights));
        let far = |pose: &[f64]| pose.chunks(6).flat_map(|v| &v[..3]).fold(0.0, |far: f64, x| far.max(x.abs()));
        // Upper bound on the sum of the terms, which may be much larger than their sum.
        let mut reach = far(&base) + far(&reference);
        for (target, weight) in weights.iter().enumerate().filter(|(_, weight)| **weight != 0.0) {
            let mut largest = 0.0f64;
            mesh.for_each_delta(target, |_, d| largest = d[..3].iter().fold(largest, |most, x| most.max(x.abs())));
            reach += largest * f64::from(weight.abs());
        }
        // Not representable in float32.
        if reach > 1e37 {
            continue;
        }
        let rounding = match (layout.format.is_blocks(), grid) {
            (true, None) => 0.0,
            (false, None) => 6e-6 * reach.max(f64::from(layout.diagonal)),
            (_, Some(_)) => 3f64.sqrt() * f64::from(f32::EPSILON) * (far(&reference) + far(&base)),
        };
        let (error, most) = (compare(&pose, &reference).position, bound + rounding + 1e-37);
        assert!(
            error <= most,
            "{desc:?}, {:?}, weights {weights:?}: off by {error:e}, at most {most:e}",
            layout.format
        );
    }
}
