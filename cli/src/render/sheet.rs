//! A contact sheet: every target by itself, with its name.

use super::canvas::{Align, Canvas};
use super::easel::Easel;
use super::scenery::{Done, Scenery};
use super::{errors, heat};
use crate::args::render::Heat;
use crate::args::values::name;
use crate::output::Failure;
use glam::Mat4;
use std::path::Path;

/// Default size of a cell, in pixels.
const CELL: [u32; 2] = [224; 2];

/// Draws the base pose, and each target at weight 1.
pub fn draw(scenery: &Scenery<'_>, output: &Path) -> Result<Done, Failure> {
    let (args, mesh) = (scenery.args, &scenery.input.kept);
    if let Some(show) = args.show.filter(|show| show.is_of_changes()) {
        let text = format!("--show {}: shows what changed since another frame; leave --sheet out", name(show));
        return Err(Failure::Usage(text));
    }
    let (cell, targets) = (args.size.unwrap_or(CELL), mesh.targets.len());
    let mut poses = vec![vec![0.0; targets]; targets + 1];
    (0..targets).for_each(|i| poses[i + 1][i] = 1.0);
    let names = std::iter::once("base pose").chain(mesh.targets.iter().map(|target| target.name.as_str()));
    let names: Vec<&str> = names.collect();

    let text = (cell[1] as f32 / 14.0).max(11.0);
    let caption = (text * 1.8) as u32;
    // Somewhat wider than high.
    let columns = ((poses.len() as f32 * 1.5).sqrt().ceil() as u32).min(poses.len() as u32);
    let rows = (poses.len() as u32).div_ceil(columns);
    let size = [columns * cell[0], rows * (cell[1] + caption)];
    if size.iter().any(|edge| *edge > 32_768) {
        let text = format!("--size: a sheet of {} × {} pixels; make the cells smaller", size[0], size[1]);
        return Err(Failure::Usage(text));
    }
    let mut sheet = Canvas::new(size, args.background);
    let mut easel = Easel::new(scenery, cell, vec![Mat4::IDENTITY])?;
    let scale = heat::prepare(scenery, &mut easel, heat::one_after_the_other(&poses))?;
    let (ink, bar) = (args.background.ink(), scenery.out.bar(poses.len() as u64));
    let mut put = |at: usize, picture: &Canvas| {
        let (column, row) = (at as u32 % columns, at as u32 / columns);
        let (left, top) = (column * cell[0], row * (cell[1] + caption));
        sheet.put(picture, [left, top]);
        let place = (left as f32 + cell[0] as f32 / 2.0, top as f32 + cell[1] as f32 + text);
        sheet.text(names[at], place, text, ink, Align::Middle, cell[0] as f32 - text * 0.5);
        bar.inc(1);
    };
    let mut ready = 0;
    for weights in &poses {
        if let (Some(Heat::Error), Some(end)) = (args.heat, scale) {
            easel.show_values(&errors::of_pose(scenery, weights)?, end)?;
            put(ready, &easel.picture(&[weights])?);
            ready += 1;
        } else if let Some(picture) = easel.draw(&[weights])? {
            put(ready, &picture);
            ready += 1;
        }
    }
    for (i, picture) in easel.finish()?.iter().enumerate() {
        put(ready + i, picture);
    }
    bar.finish_and_clear();
    sheet.save(output)?;
    let what = format!("a sheet of the base pose and {targets} targets");
    Ok(Done { what, size, frames: poses.len(), scale, kept: None })
}
