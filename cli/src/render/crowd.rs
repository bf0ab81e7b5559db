//! A pose, or a crowd, each instance with its own expression.

use super::easel::Easel;
use super::heat;
use super::scenery::{Done, Scenery, bounds};
use crate::output::Failure;
use deltamorph_render::Show;
use glam::{Mat4, Vec3};
use std::path::Path;

/// Default sizes of a crowd and of one instance, in pixels.
const SIZE: [u32; 2] = [1280, 720];
const SINGLE: [u32; 2] = [768; 2];

pub fn draw(scenery: &Scenery<'_>, heads: Option<u32>, output: &Path) -> Result<Done, Failure> {
    let size = scenery.args.size.unwrap_or(if heads.is_some() { SIZE } else { SINGLE });
    let [poses, before] = match heads {
        Some(heads) => expressions(scenery, heads as usize)?,
        None => scenery.weights()?.map(|weights| vec![weights]),
    };
    let places = heads.map_or_else(|| vec![Mat4::IDENTITY], |heads| places(&scenery.subject.focus, heads, size));
    let mut easel = Easel::new(scenery, size, places)?;
    let [poses, before] = [&poses, &before].map(|poses| poses.iter().map(Vec::as_slice).collect::<Vec<_>>());
    let scale = heat::prepare(scenery, &mut easel, poses.iter().copied().zip(before.iter().copied()))?;
    if matches!(scenery.args.look(), Show::Motion | Show::Blocks) {
        easel.picture(&before)?;
    }
    easel.picture(&poses)?.save(output)?;
    let what = match (heads, easel.draws()) {
        (None, _) => {
            let active = poses[0].iter().filter(|weight| **weight != 0.0).count();
            format!("{active} active of {} targets", poses[0].len())
        }
        (Some(heads), [_, 0]) => format!("a crowd of {heads} instances"),
        (Some(heads), [draws, spared]) => {
            format!("a crowd of {heads} instances, {spared} of {} draws culled", draws + spared)
        }
    };
    Ok(Done { what, size, frames: 1, scale })
}

/// Weights of frames spread over the clip, and of the frame before each.
fn expressions(scenery: &Scenery<'_>, heads: usize) -> Result<[Vec<Vec<f32>>; 2], Failure> {
    let (frames, _) = scenery.frames()?;
    let at = |head: usize| head * frames.len() / heads;
    let now = (0..heads).map(|head| frames[at(head)].clone());
    let before = (0..heads).map(|head| frames[at(head).saturating_sub(1)].clone());
    Ok([now.collect(), before.collect()])
}

/// Places in rows that fill the picture, each row behind and slightly above the one in front; instances turn slightly
/// towards the middle.
pub fn places(focus: &[Vec3], heads: u32, [width, height]: [u32; 2]) -> Vec<Mat4> {
    let (low, high) = bounds(focus.iter().copied());
    let middle = (low + high) / 2.0;
    let extent = (high - low).max(Vec3::splat(f32::MIN_POSITIVE));
    let across = extent.x * 1.12;
    let behind = extent.z * 0.95;
    let up = extent.y * 0.66;
    // Ratio of instances per row to rows if the rows fill the picture.
    let wide = width as f32 / height as f32 * up / across;
    let rows = ((heads as f32 / wide).sqrt().round() as u32).clamp(1, heads);
    let place = |i: u32| {
        let row = i * rows / heads;
        let first = (row * heads).div_ceil(rows);
        let end = ((row + 1) * heads).div_ceil(rows);
        let shift = if row % 2 == 1 && (end - first) * rows >= heads { 0.25 } else { -0.25 };
        let shift = if rows > 1 { shift } else { 0.0 };
        let x = ((i - first) as f32 + shift - (end - first - 1) as f32 / 2.0) * across;
        let offset = Vec3::new(x, row as f32 * up, -(row as f32) * behind);
        let turn = Mat4::from_rotation_y(-0.35 * x / ((end - first) as f32 * across));
        Mat4::from_translation(middle + offset) * turn * Mat4::from_translation(-middle)
    };
    (0..heads).map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heads_stand_apart() {
        let focus = [Vec3::ZERO, Vec3::new(2.0, 3.0, 2.0)];
        for heads in [1, 2, 7, 40] {
            let middles: Vec<Vec3> =
                places(&focus, heads, SIZE).iter().map(|p| p.transform_point3(Vec3::new(1.0, 1.5, 1.0))).collect();
            assert_eq!(middles.len(), heads as usize);
            for (i, a) in middles.iter().enumerate() {
                assert!(middles[..i].iter().all(|b| a.distance(*b) > 2.0), "{heads}: {middles:?}");
            }
        }
    }
}
