//! Before and after: the imported mesh, and its pose in the path and formats chosen.

use super::canvas::{Align, Canvas};
use super::easel::Easel;
use super::errors::of_pose;
use super::scenery::{Done, SIZE, Scenery};
use crate::output::Failure;
use deltamorph::reference::evaluate_unpacked;
use std::path::Path;

/// Draws the pose of the imported mesh, and next to it that of path and formats, with its error multiplied by `factor`.
pub fn draw(scenery: &Scenery<'_>, factor: f32, output: &Path) -> Result<Done, Failure> {
    let (stage, [weights, _]) = (scenery.stage, scenery.weights()?);
    let [width, height] = scenery.args.size.unwrap_or([2 * SIZE[0], SIZE[1]]);
    let expected = evaluate_unpacked(&scenery.input.kept, &weights);
    let mut runner = stage.runner(stage.desc)?;
    runner.step(&[&weights], 0)?;
    let further = |(pose, expected): (f32, &f64)| (expected + f64::from(factor) * (f64::from(pose) - expected)) as f32;
    let magnified: Vec<f32> = runner.pose(0)?.into_iter().zip(&expected).map(further).collect();
    let before: Vec<f32> = expected.iter().map(|number| *number as f32).collect();
    let most = of_pose(scenery, &weights)?.into_iter().fold(0.0, f32::max);

    let mut easel = Easel::of_given_poses(scenery, [width / 2, height])?;
    let mut canvas = Canvas::new([width, height], scenery.args.background);
    let (ink, text) = (scenery.args.background.ink(), (height as f32 / 36.0).max(11.0));
    let share = f64::from(most) / crate::verify::scale(scenery.diagonal());
    let packed =
        format!("{} times the error of {}: at most {most:.2e}, {share:.1e} of the diagonal", factor, stage.formats());
    for (i, (pose, caption)) in [(&before, "as imported"), (&magnified, packed.as_str())].into_iter().enumerate() {
        let left = i as u32 * (width / 2);
        canvas.put(&easel.picture_of(stage, pose)?, [left, 0]);
        let (x, y) = (left as f32 + width as f32 / 4.0, height as f32 - text * 0.8);
        canvas.text(caption, (x, y), text, ink, Align::Middle, width as f32 / 2.0 - text);
    }
    canvas.save(output)?;
    let what = format!("before and after, at {factor} times an error of {share:.1e} of the diagonal");
    Ok(Done { what, size: [width, height], frames: 1, scale: None, kept: None })
}
