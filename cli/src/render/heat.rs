//! Heat maps, and their scale.

use super::canvas::{Align, Canvas};
use super::easel::Easel;
use super::errors;
use super::scenery::Scenery;
use crate::args::render::Heat;
use crate::output::Failure;
use deltamorph_render::{Show, heat};

/// Prepare a heat map for poses of these weights; returns the end of its scale, in input units.
pub fn prepare(scenery: &Scenery<'_>, easel: &mut Easel<'_>, poses: &[Vec<f32>]) -> Result<Option<f32>, Failure> {
    let Some(kind) = scenery.args.heat else { return Ok(None) };
    let largest = |values: &[f32]| values.iter().copied().fold(0.0, f32::max);
    let end = match (kind, scenery.args.scale) {
        (_, Some(end)) => end,
        (Heat::Distance, None) => {
            poses.iter().map(|weights| largest(&errors::distances(scenery, weights))).fold(0.0, f32::max)
        }
        (Heat::Error, None) => {
            let errors = poses.iter().map(|weights| errors::of_pose(scenery, weights));
            errors
                .map(|values| values.map(|values| largest(&values)))
                .try_fold(0.0, |a, b| Ok::<_, Failure>(f32::max(a, b?)))?
        }
    };
    // All where it should be: the scale ends where float32 does.
    let end = if end > 0.0 { end } else { scenery.diagonal().max(1.0) * f32::EPSILON };
    easel.scene.show = if kind == Heat::Distance { Show::Distance(end) } else { Show::Values(end) };
    Ok(Some(end))
}

/// Draw the scale of a heat map, and what it stands for.
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
    let what = scenery.args.heat.map_or("", Heat::name);
    let most_text = format!("{what} {end:.3e} ({share:.1e} of the diagonal)");
    canvas.text(&most_text, (x, top as f32 + text * 0.4), text, ink, Align::Left, most);
    canvas.text("0", (x, (top + bar) as f32), text, ink, Align::Left, most);
}
