//! Heat maps, and their scale.

use super::canvas::{Align, Canvas};
use super::easel::Easel;
use super::errors;
use super::scenery::Scenery;
use crate::args::render::{Heat, Shown};
use crate::args::values::name;
use crate::output::Failure;
use deltamorph_render::{Show, heat};

/// Prepares a heat map for poses, each with the weights before it; returns the end of its scale, in input units.
pub fn prepare<'p>(
    scenery: &Scenery<'_>,
    easel: &mut Easel<'_>,
    poses: impl Iterator<Item = (&'p [f32], &'p [f32])>,
) -> Result<Option<f32>, Failure> {
    let (kind, args) = (scenery.args.heat, scenery.args);
    let moving = args.show == Some(Shown::Motion);
    if kind.is_none() && !moving {
        return match args.scale {
            Some(_) => {
                Err(Failure::Usage("--scale: where the colours of --heat or --show motion end; give one".into()))
            }
            None => Ok(None),
        };
    }
    let largest = |values: Vec<f32>| values.into_iter().fold(0.0, f32::max);
    let of_pose = |(weights, before): (&[f32], &[f32])| match kind {
        Some(Heat::Distance) => Ok(largest(errors::distances(scenery, weights))),
        Some(Heat::Error) => errors::of_pose(scenery, weights).map(largest),
        // Poses are linear in the weights.
        None => {
            let step: Vec<f32> = weights.iter().zip(before).map(|(now, before)| now - before).collect();
            Ok(largest(errors::distances(scenery, &step)))
        }
    };
    let end = match args.scale {
        Some(end) => end,
        None => poses.map(of_pose).try_fold(0.0, |a, b| Ok::<_, Failure>(f32::max(a, b?)))?,
    };
    // If nothing deviates, the scale ends at float32 precision.
    let end = if end > 0.0 { end } else { scenery.diagonal().max(1.0) * f32::EPSILON };
    easel.scene.show = match kind {
        Some(Heat::Distance) => Show::Distance(end),
        Some(Heat::Error) => Show::Values(end),
        None => Show::Motion(end),
    };
    Ok(Some(end))
}

/// Consecutive poses, each with the one before it; the first one with itself.
pub fn one_after_the_other(poses: &[Vec<f32>]) -> impl Iterator<Item = (&[f32], &[f32])> {
    poses.iter().zip(poses.first().into_iter().chain(poses)).map(|(now, before)| (&now[..], &before[..]))
}

/// Draws the scale of a heat map, and its meaning.
pub fn draw_scale(scenery: &Scenery<'_>, canvas: &mut Canvas, end: f32) {
    let [width, height] = canvas.size;
    let (ink, text) = (scenery.args.background.ink(), (width.min(height) as f32 / 36.0).max(11.0));
    let (bar, wide) = (height / 3, (text * 0.8) as u32);
    let (left, top) = (text as u32, height - bar - (text * 1.6) as u32);
    for y in 0..bar {
        canvas.fill([left, top + y], [wide, 1], heat(1.0 - y as f32 / bar.max(2) as f32));
    }
    let share = f64::from(end) / crate::verify::scale(scenery.diagonal());
    let (x, most) = (left as f32 + wide as f32 + 0.4 * text, width as f32 * 0.6);
    let what = scenery.args.heat.map_or("a frame".into(), name);
    let most_text = format!("{what} {end:.3e} ({share:.1e} of the diagonal)");
    canvas.text(&most_text, (x, top as f32 + text * 0.4), text, ink, Align::Left, most);
    canvas.text("0", (x, (top + bar) as f32), text, ink, Align::Left, most);
}
