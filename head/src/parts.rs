//! Eyeballs, teeth and tongue: separate closed surfaces.

use super::spot::Part;
use super::{EYE, EYE_RADIUS, MOUTH_HEIGHT, TONGUE_HEIGHT, cos, mix, sin, smoothstep};
use deltamorph::glam::Vec3;

/// Returns the parts of a head of `vertices` vertices, with the side and number of vertices of each.
pub fn counts(vertices: usize) -> Vec<(Part, bool, usize)> {
    let all = [
        (Part::Eye, false, 0.03),
        (Part::Eye, true, 0.03),
        (Part::UpperTeeth, false, 0.035),
        (Part::LowerTeeth, false, 0.03),
        (Part::Tongue, false, 0.01),
    ];
    let counted = all.into_iter().map(|(part, side, share)| (part, side, (vertices as f32 * share) as usize));
    // Too few vertices to form the shape.
    counted.filter(|part| part.2 >= 8).collect()
}

/// Returns the texture tile of a part, as an offset of u.
pub const fn tile(part: Part) -> f32 {
    match part {
        Part::Skin => 0.0,
        Part::Eye => 1.0,
        Part::UpperTeeth | Part::LowerTeeth => 2.0,
        Part::Tongue => 3.0,
    }
}

/// Returns the number of rows per column.
pub const fn aspect(part: Part) -> f32 {
    match part {
        Part::Skin | Part::Eye => 0.8,
        Part::UpperTeeth | Part::LowerTeeth => 0.12,
        Part::Tongue => 1.2,
    }
}

const TURN: f64 = 2.0 * std::f64::consts::PI;

/// Returns a point of a part, `around` in (−1/2, 1/2] of a turn about its axis, `along` in 0..=1 from pole to pole.
pub fn point(part: Part, around: f32, along: f32) -> Vec3 {
    let angle = f64::from(around) * TURN;
    let (s, c) = (sin(angle) as f32, cos(angle) as f32);
    match part {
        Part::Skin => Vec3::ZERO,
        Part::Eye => eyeball(s, c, along),
        Part::UpperTeeth => teeth(around, along, 1.0),
        Part::LowerTeeth => teeth(around, along, -1.0),
        Part::Tongue => tongue(s, c, along),
    }
}

/// A point of the eyeball. Iris and pupil are hollows, so that they show without a texture too.
fn eyeball(s: f32, c: f32, along: f32) -> Vec3 {
    // Denser in front.
    let angle = f64::from(along * (0.5 + 0.5 * along)) * TURN * 0.5;
    let (lateral, ahead) = (sin(angle) as f32, cos(angle) as f32);
    let radius = lateral * EYE_RADIUS;
    let dish = 0.1 * smoothstep(0.66, 0.56, radius) + 0.12 * smoothstep(0.3, 0.2, radius);
    let dish = if ahead > 0.0 { dish } else { 0.0 };
    EYE + Vec3::new(radius * s, radius * c, ahead * EYE_RADIUS - dish)
}

/// Distance to the front of the teeth, half their width, and their depth.
const ARCH: [f32; 3] = [8.0, 2.6, 4.5];
/// Number of teeth in a whole turn, of which the front half has some.
const TEETH: f32 = 26.0;

/// A point of the cup around palate or tongue, whose rim is the teeth. `up` is 1 for the upper teeth.
fn teeth(around: f32, along: f32, up: f32) -> Vec3 {
    // The angle from the front in turns: denser there.
    let back = 1.0 - 2.0 * around.abs();
    let turn = 0.5 * back * (0.6 + 0.4 * back);
    let angle = f64::from(turn) * TURN;
    let (s, ahead) = (1f32.copysign(around) * sin(angle) as f32, cos(angle) as f32);
    // Down the outer side, over the edge, up the inner side.
    let (reach, height): (f32, f32) = if along < 0.25 {
        (along * 4.0, 1.0)
    } else if along < 0.5 {
        (1.0, 1.0 - (along - 0.25) * 4.0)
    } else if along < 0.6 {
        (1.0 - (along - 0.5) * 1.8, 0.0)
    } else if along < 0.8 {
        (0.82, (along - 0.6) * 4.0)
    } else {
        ((1.0 - along) * 4.1, mix(0.8, 0.9, smoothstep(0.8, 0.9, along)))
    };
    // Squarer than an ellipse, and cut off behind.
    let x = s * (1.1 - 0.1 * s * s);
    let arch = Vec3::new(ARCH[1] * x, 0.0, if ahead > 0.0 { ARCH[2] * ahead } else { 0.5 * ahead });
    // The gaps between the teeth, and their crowns.
    let gap = (TEETH * turn) % 1.0 * 2.0 - 1.0;
    let crown = if ahead > 0.0 && along < 0.65 { 1.0 - gap * gap * gap * gap } else { 1.0 };
    let behind = smoothstep(-0.1, 0.4, ahead);
    let small = if up > 0.0 { 0.0 } else { -0.18 };
    let scale = reach * (1.0 + (small - 0.12 * (1.0 - crown)) / 2.7);
    let edge = MOUTH_HEIGHT + if up > 0.0 { -0.42 } else { -0.48 };
    let tall = if up > 0.0 { 1.3 } else { 0.95 } * mix(0.3, 1.0, behind);
    let drop = if behind < 1.0 { (1.0 - behind) * 0.6 } else { 0.0 };
    let y = edge + up * (drop + tall * height + 0.12 * (1.0 - crown) * (1.0 - height));
    Vec3::new(arch.x * scale, y, ARCH[0] - ARCH[2] + arch.z * scale)
}

fn tongue(s: f32, c: f32, along: f32) -> Vec3 {
    let angle = f64::from(along) * TURN * 0.5;
    let (round, ahead) = (sin(angle) as f32, cos(angle) as f32);
    let wide = 1.25 * round;
    let groove = 0.12 * smoothstep(0.5, 0.0, s.abs()) * if c < 0.0 { 1.0 } else { 0.0 };
    let y = TONGUE_HEIGHT - c * round * 0.4 - groove * round;
    Vec3::new(s * wide, y, 5.2 + 1.8 * ahead)
}
