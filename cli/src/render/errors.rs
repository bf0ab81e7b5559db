//! Distances and errors of poses, per vertex.

use super::scenery::Scenery;
use crate::output::Failure;
use deltamorph::POSE_FLOATS;
use deltamorph::reference::evaluate_unpacked;

/// Distance of each vertex from its position in `from`, in float64.
fn far<'a>(pose: impl Iterator<Item = &'a [f64]>, from: impl Iterator<Item = [f64; 3]>) -> Vec<f32> {
    let off = |(a, b): (&[f64], [f64; 3])| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt() as f32;
    pose.zip(from).map(off).collect()
}

/// Distance of each vertex from the base pose.
pub fn distances(scenery: &Scenery<'_>, weights: &[f32]) -> Vec<f32> {
    let mesh = &scenery.input.kept;
    let pose = evaluate_unpacked(mesh, weights);
    far(pose.chunks_exact(POSE_FLOATS), mesh.positions.iter().map(|p| p.as_dvec3().to_array()))
}

/// Distance of each vertex from the float64 evaluation of the imported mesh, for the chosen path and formats.
pub fn of_pose(scenery: &Scenery<'_>, weights: &[f32]) -> Result<Vec<f32>, Failure> {
    let mut runner = scenery.stage.runner(scenery.stage.desc)?;
    runner.step(&[weights], 0)?;
    let pose: Vec<f64> = runner.pose(0)?.into_iter().map(f64::from).collect();
    let expected = evaluate_unpacked(&scenery.input.kept, weights);
    let expected = expected.chunks_exact(POSE_FLOATS).map(|v| [v[0], v[1], v[2]]);
    Ok(far(pose.chunks_exact(POSE_FLOATS), expected))
}
