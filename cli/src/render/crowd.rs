//! The places of a crowd.

use super::subject::bounds;
use glam::{Mat4, Vec3};

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
