//! Colours that stand for lengths: the end of their scale.

use super::easel::Easel;
use super::scenery::Scenery;
use crate::output::Failure;
use deltamorph::POSE_FLOATS;
use deltamorph::reference::evaluate_unpacked;
use deltamorph_render::Show;

/// Has the easel show lengths, if they are to be shown, of poses, each with the weights before it. Returns the end of
/// the scale, in input units.
pub fn prepare<'p>(
    scenery: &Scenery<'_>,
    easel: &mut Easel<'_>,
    poses: impl Iterator<Item = (&'p [f32], &'p [f32])>,
) -> Result<Option<f32>, Failure> {
    let look = scenery.args.look();
    if !matches!(look, Show::Heat | Show::Motion) {
        return match scenery.args.scale {
            Some(_) => Err(Failure::Usage(
                "--scale is the upper end of the colour scale of --show heat or motion; give one of these".into(),
            )),
            None => Ok(None),
        };
    }
    let largest = |(weights, before): (&[f32], &[f32])| match look {
        // Poses are linear in the weights.
        Show::Motion => {
            let step: Vec<f32> = weights.iter().zip(before).map(|(now, before)| now - before).collect();
            furthest(scenery, &step)
        }
        _ => furthest(scenery, weights),
    };
    let end = scenery.args.scale.unwrap_or_else(|| poses.map(largest).fold(0.0, f32::max));
    // If nothing moves, the scale ends at float32 precision.
    let end = if end > 0.0 { end } else { scenery.input.kept.diagonal.max(1.0) * f32::EPSILON };
    easel.scene.end = end;
    Ok(Some(end))
}

/// Consecutive poses, each with the one before it; the first one with itself.
pub fn one_after_the_other(poses: &[Vec<f32>]) -> impl Iterator<Item = (&[f32], &[f32])> {
    poses.iter().zip(poses.first().into_iter().chain(poses)).map(|(now, before)| (&now[..], &before[..]))
}

/// The largest distance of a vertex from the base pose.
fn furthest(scenery: &Scenery<'_>, weights: &[f32]) -> f32 {
    let mesh = &scenery.input.kept;
    let pose = evaluate_unpacked(mesh, weights);
    let base = mesh.positions.iter().map(|p| p.as_dvec3().to_array());
    let squares = pose
        .chunks_exact(POSE_FLOATS)
        .zip(base)
        .map(|(vertex, base)| vertex.iter().zip(base).map(|(now, base)| (now - base).powi(2)).sum::<f64>());
    squares.fold(0.0, f64::max).sqrt() as f32
}
