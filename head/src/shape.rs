//! The skin of the head: sections stacked along a profile, the features of a face pushed out of them, and the surfaces
//! behind its openings: the linings of eye sockets and mouth, the shells of the ears. Lengths in cm.

use super::spot::{Slit, Spot};
use super::{EYE, EYE_RADIUS, HALF_MOUTH, MOUTH_HEIGHT, cos, mix, sin, smoothstep};
use deltamorph::glam::{Vec2, Vec3};

/// Cross-sections from the crown to the end of the neck: height, half width, front, back, and the flattening of the
/// front relative to an ellipse. They include the rows of eyes, ears and mouth: see [`Slit::row`].
pub const SECTIONS: [[f32; 5]; 22] = [
    [12.0, 0.0, -0.9, -0.9, 0.0],
    [11.7, 2.4, 1.9, -4.0, 0.0],
    [10.8, 4.3, 4.5, -6.7, 0.1],
    [9.2, 5.7, 6.6, -8.6, 0.2],
    [7.2, 6.6, 7.9, -9.7, 0.3],
    [5.0, 7.05, 8.5, -10.1, 0.4],
    [2.6, 7.2, 8.6, -9.9, 0.5],
    [1.0, 7.1, 8.3, -9.4, 0.55],
    [-0.6, 7.0, 8.2, -8.6, 0.55],
    [-2.2, 6.85, 8.3, -7.8, 0.5],
    [-3.8, 6.6, 8.45, -7.1, 0.45],
    [-5.4, 6.25, 8.5, -6.6, 0.4],
    [-7.0, 5.7, 8.4, -6.2, 0.3],
    [-8.5, 4.9, 8.2, -6.0, 0.2],
    [-9.7, 4.2, 7.5, -5.9, 0.1],
    [-10.5, 4.0, 5.6, -5.9, 0.05],
    [-11.2, 4.0, 3.4, -6.0, 0.0],
    [-12.4, 4.1, 2.1, -6.2, 0.0],
    [-14.0, 4.4, 1.8, -6.5, 0.0],
    [-16.0, 5.2, 2.1, -7.2, 0.0],
    [-16.5, 4.7, 1.5, -6.7, 0.0],
    [-16.6, 0.0, -2.6, -2.6, 0.0],
];

/// Returns the section at `t` in 0..=21.
pub fn section(t: f32) -> [f32; 5] {
    let mut s = spline(&SECTIONS, t);
    s[1] = s[1].max(0.0);
    s
}

/// Evaluates the uniform cubic B-spline that begins and ends at the first and last of `knots`, at `t` between their
/// indices.
fn spline<const N: usize>(knots: &[[f32; N]], t: f32) -> [f32; N] {
    let last = knots.len() - 1;
    let i = (t as usize).min(last - 1);
    let x = t - i as f32;
    let (b, c) = (knots[i], knots[i + 1]);
    let beyond = |near: [f32; N], far: [f32; N]| std::array::from_fn(|k| 2.0 * near[k] - far[k]);
    let a = if i > 0 { knots[i - 1] } else { beyond(b, c) };
    let d = if i + 2 <= last { knots[i + 2] } else { beyond(c, b) };
    let rest = 1.0 - x;
    let weights = [
        rest * rest * rest,
        3.0 * x * x * x - 6.0 * x * x + 4.0,
        3.0 * rest * rest * rest - 6.0 * rest * rest + 4.0,
        x * x * x,
    ];
    std::array::from_fn(|k| (weights[0] * a[k] + weights[1] * b[k] + weights[2] * c[k] + weights[3] * d[k]) / 6.0)
}

/// Returns the plain head at the angle `a` from the front (0..=π) and the row `t`, and how much it faces the front
/// (−1..=1).
pub fn plain(a: f32, t: f32) -> (Vec3, f32) {
    let [y, half, front, back, flat] = section(t);
    // Exactly in the middle at the back, since π is not a float.
    let s = if a < std::f32::consts::PI { sin(f64::from(a)) as f32 } else { 0.0 };
    let c = cos(f64::from(a)) as f32;
    // A section is widest behind its middle: at the ears, and at the corners of the jaw.
    let middle = back + 0.44 * (front - back);
    let z = if c > 0.0 { (front - middle) * c * (1.0 + flat * (1.0 - c)) } else { (middle - back) * c };
    (Vec3::new(half * s, y, middle + z), c)
}

/// The opening of the lids, 1 at rest.
#[derive(Clone, Copy)]
pub struct Lids {
    /// The distance between the edges; 0 is closed.
    pub open: f32,
    /// Distance of the lower lid's edge below the line between the corners; negative above it.
    pub lower: f32,
}

impl Lids {
    pub const REST: Self = Self { open: 1.0, lower: 1.0 };
}

/// Thickness of the lids, and the gap between them and the eyeball.
const LID: f32 = 0.16;
const EYE_GAP: f32 = 0.05;
/// Distance of the outside of the lids from the middle of the eyeball.
pub const LID_RADIUS: f32 = EYE_RADIUS + EYE_GAP + LID;
/// The gap between closed lids, and between lips that meet.
const CONTACT: f32 = 0.006;
/// Half the distance between the corners of an eye.
pub const HALF_EYE: f32 = 1.4;
/// The root of the ear on the head: height, depth, half height, half width.
pub const EAR: [f32; 4] = [-0.6, -1.25, 2.1, 1.15];
/// Distance of the ear's hollow from the middle of the head.
const EAR_ROOT: f32 = 6.8;

/// The ridge of the nose from the brows down, every half centimetre: how far it stands out, and half its width.
const NOSE: [[f32; 2]; 16] = [
    [0.0, 1.6],
    [0.03, 1.5],
    [0.1, 1.3],
    [0.25, 1.1],
    [0.5, 1.0],
    [0.75, 1.0],
    [1.0, 1.1],
    [1.25, 1.2],
    [1.52, 1.35],
    [1.82, 1.45],
    [2.05, 1.55],
    [2.15, 1.6],
    [1.75, 1.5],
    [0.5, 1.1],
    [0.05, 1.0],
    [0.0, 1.0],
];

/// Returns the heights of the lids' edges above the line of the eye, at `c` from the inner corner (−1) to the outer
/// (1).
fn edges(c: f32, lids: Lids) -> (f32, f32) {
    let w = dome(c);
    let (upper, lower) = (0.5 * (w * w.sqrt()).sqrt() * (1.0 - 0.12 * c), 0.46 * w * (1.0 + 0.2 * c));
    let below = -lower * lids.lower;
    (below + (upper + lower) * lids.open + CONTACT, below - CONTACT)
}

/// Returns a smooth bump: 1 at the centre, 0 outside an ellipse slightly larger than that of the given radii.
fn bump(x: f32, y: f32, centre: [f32; 2], radii: [f32; 2]) -> f32 {
    let (dx, dy) = ((x - centre[0]) / radii[0], (y - centre[1]) / radii[1]);
    let q = (1.0 - 0.8 * (dx * dx + dy * dy)).max(0.0);
    q * q * q
}

/// Returns 1 − x² between −1 and 1, 0 beyond.
fn dome(x: f32) -> f32 {
    (1.0 - x * x).max(0.0)
}

/// Returns the direction of a slit's edge: 1 is up.
fn side(lower: bool) -> f32 {
    if lower { -1.0 } else { 1.0 }
}

/// Returns the larger of two numbers, with a smooth transition over about `k`.
fn smooth_max(a: f32, b: f32, k: f32) -> f32 {
    let h = (1.0 - (a - b).abs() / k).max(0.0);
    a.max(b) + 0.25 * k * h * h
}

/// Returns the motion of a row at the distance `d` from a slit whose edge moves by 1, up to the distance `reach`.
fn along(d: f32, reach: f32) -> f32 {
    let q = (1.0 - d.abs() / reach).max(0.0);
    q * q
}

/// Returns a point of the skin, on the head's left side. At a slit, `lower` is the lower edge.
pub fn skin(a: f32, t: f32, lower: bool, lids: Lids) -> Vec3 {
    let (mut p, facing) = plain(a, t);
    let below = |slit: Slit| t > slit.row() || (t == slit.row() && lower);
    let front = smoothstep(0.0, 0.3, facing);

    // Rows give way to the openings of eyes and ears.
    let c = (p.x - EYE.x) / HALF_EYE;
    let (up, down) = edges(c, lids);
    let d = p.y - EYE.y;
    let tilt = 0.12 * c.clamp(-1.6, 1.6) * along(d, 3.0);
    let eye = if below(Slit::Eye) { down * along(d, 2.0) } else { up * along(d, 2.2) };
    let yield_ear = along(p.y - EAR[0], 5.0);
    let c_ear = (p.z - EAR[1]) / EAR[3];
    let ear = if c_ear.abs() < 1.0 {
        // Distributed about evenly around the ellipse: the sine of an angle.
        let sine = c_ear * (1.5 - 0.5 * c_ear * c_ear);
        p.z = mix(p.z, EAR[1] + EAR[3] * sine, yield_ear);
        EAR[2] * dome(sine).sqrt() * yield_ear * side(below(Slit::Ear))
    } else {
        0.0
    };
    let eye = if c.abs() < 1.0 { eye } else { 0.0 };
    let lip = p.y - MOUTH_HEIGHT;
    p.y += (eye + tilt) * front + ear;
    features(p, lip, below(Slit::Mouth), front, LID_RADIUS)
}

/// Pushes the features of a face out of the plain head. `lip` is the distance above the line between the lips, `lid`
/// the distance of the lids from the middle of the eyeball.
fn features(mut p: Vec3, lip: f32, lower_lip: bool, front: f32, lid: f32) -> Vec3 {
    let (x, y) = (p.x, p.y);
    let at = |centre: [f32; 2], radii: [f32; 2]| bump(x, y, centre, radii);
    let mut z = 0.0;

    // Forehead, brow ridge, eyebrows, temples, cheekbones and the hollow under them.
    z += 0.3 * at([0.0, 6.2], [6.0, 3.2]) + 0.2 * at([0.0, 3.1], [2.2, 1.8]);
    z += 0.4 * at([3.1, 2.9], [3.2, 1.6]) + 0.7 * at([5.1, 0.8], [2.0, 2.8]);
    let brow = (x - 1.0) / 3.8;
    let arch = 2.9 + 0.8 * brow - 1.05 * brow * brow;
    z += 0.15 * at([x, arch], [1.0, mix(0.5, 0.3, brow)]) * smoothstep(-0.1, 0.25, brow) * smoothstep(1.02, 0.7, brow);
    z += 0.5 * at([4.2, -1.4], [3.0, 2.4]) - 0.2 * at([4.4, -4.8], [2.2, 2.6]);
    // Sockets, deepest beside the nose.
    z -= 0.5 * at([3.2, 1.3], [2.6, 1.5]) + 0.12 * at([1.5, 1.4], [1.2, 1.6]);
    z += 0.25 * at([3.3, -0.7], [2.8, 1.8]);

    // Nose: the ridge, the tip, the wings, and the nostrils.
    let [ridge, width] = spline(&NOSE, ((3.0 - y) * 2.0).clamp(0.0, (NOSE.len() - 1) as f32));
    let across = dome(x / width);
    z += ridge * across * across + 0.2 * at([0.0, -2.5], [1.0, 0.9]);
    z += 0.75 * at([1.2, -2.7], [0.75, 0.8]) * smoothstep(-3.4, -2.9, y);
    z -= 0.55 * at([0.6, -3.1], [0.42, 0.3]);

    // Mouth: the muzzle, the groove under the nose, lips, the fold under them, the chin.
    let mouth = (x / HALF_MOUTH).min(1.5);
    z += 0.65 * at([0.0, -5.2], [4.4, 3.3]);
    z -= 0.14 * at([0.0, -4.1], [0.5, 0.8]);
    z += lips(mouth, lip.abs(), lower_lip);
    z -= 0.2 * at([2.8, -5.4], [1.3, 1.3]);
    z -= 0.3 * at([0.0, -7.2], [2.6, 1.0]);
    z += 0.7 * at([0.0, -8.9], [2.6, 1.8]);
    p.z += z * front;
    // The corners of the mouth are a little higher.
    if lip == 0.0 {
        p.y += CONTACT * dome(mouth) * side(lower_lip);
    }
    p.y += 0.1 * mouth * mouth * along(lip, 2.5) * front * smoothstep(1.5, 1.0, mouth);

    // Lids lie on the eyeball, at points where the socket is deeper.
    let from = Vec2::new(x - EYE.x, y - EYE.y);
    let ball = EYE.z + (lid * lid - from.length_squared()).max(0.0).sqrt();
    if front > 0.0 && from.length() < lid {
        p.z = smooth_max(p.z, ball, 0.6);
    }
    p
}

/// Returns how far the lips stand out at `mouth` from the middle (0) to the corner (1), `d` from the line between them.
fn lips(mouth: f32, d: f32, lower: bool) -> f32 {
    let full = dome(mouth);
    let bow = if lower { 0.0 } else { 0.2 * bump(mouth, 0.0, [0.27, 0.0], [0.28, 1.0]) };
    let height = (if lower { 1.2 } else { 0.95 } + bow) * (0.25 + 0.75 * full);
    let s = (d / height).min(1.0);
    // Round where the lips meet, then a slope to the edge of the red.
    let (round, most) = (1.0 - s / 0.4, if lower { 0.45 } else { 0.36 });
    let out = if round > 0.0 { mix(0.26, most, (1.0 - round * round).sqrt()) } else { most * smoothstep(1.1, 0.3, s) };
    (out - 0.1 * along(d, 0.2)) * smoothstep(1.05, 0.5, mouth)
}

/// Returns a point behind an opening, at `depth` from the edge's point `edge` (0) to the end (1).
pub fn behind(slit: Slit, spot: &Spot, depth: f32, lids: Lids) -> Vec3 {
    let edge = skin(spot.a, spot.t, spot.lower, lids);
    match slit {
        Slit::Eye => socket(edge, skin(spot.a, spot.t, spot.lower, Lids::REST), depth),
        Slit::Mouth => cavity(edge, side(spot.lower), depth),
        Slit::Ear => shell(edge, depth),
    }
}

/// Evaluates a curve through `knots` of `(depth, values)`.
fn curve<const N: usize>(knots: &[(f32, [f32; N])], depth: f32) -> [f32; N] {
    let i = knots.partition_point(|k| k.0 < depth).clamp(1, knots.len() - 1);
    let ((from, a), (to, b)) = (knots[i - 1], knots[i]);
    let x = ((depth - from) / (to - from)).clamp(0.0, 1.0);
    std::array::from_fn(|k| mix(a[k], b[k], x))
}

/// Returns a point of the lid's edge or of the socket around the eyeball, from the opening to the point behind it.
/// `edge` is the current position of the lid, `rest` that at rest.
fn socket(edge: Vec3, rest: Vec3, depth: f32) -> Vec3 {
    const MARGIN: f32 = 0.15;
    if depth >= 1.0 {
        return EYE - Vec3::Z * (EYE_RADIUS + 0.65);
    }
    let toward = (edge - EYE).normalize_or(Vec3::Z);
    let at_rest = (rest - EYE).normalize_or(Vec3::Z);
    let lateral = Vec2::new(at_rest.x, at_rest.y);
    // The tangent of half the angle from the front: 0 in front, infinite behind.
    let back = ((depth - MARGIN) / (1.0 - MARGIN)).max(0.0);
    let turn = f64::from(back) * std::f64::consts::FRAC_PI_2;
    let q = lateral.length() / (1.0 + at_rest.z) + (sin(turn) / cos(turn).max(1e-6)) as f32;
    let (sine, cosine) = (2.0 * q / (1.0 + q * q), (1.0 - q * q) / (1.0 + q * q));
    let sideways = lateral.normalize_or(Vec2::Y) * sine;
    let lining = Vec3::new(sideways.x, sideways.y, cosine);
    // The surface behind a lid slides with it, less and less.
    let direction = mix3(toward, lining, smoothstep(MARGIN, 0.6, depth)).normalize_or(Vec3::Z);
    // Behind the widest part of the eyeball there is room, so that even a few rings enclose it. Sliding lids need room
    // as well, since they move in a straight line.
    let slack = 0.12 * (toward - at_rest).length();
    let room = EYE_RADIUS + EYE_GAP + 0.6 * smoothstep(1.0, -0.6, direction.z) + slack;
    EYE + direction * mix((edge - EYE).length(), room, (depth / MARGIN).min(1.0))
}

fn mix3(a: Vec3, b: Vec3, x: f32) -> Vec3 {
    a + (b - a) * x
}

/// Returns a point of the inner side of the lips or of the hollow of the mouth.
fn cavity(edge: Vec3, above: f32, depth: f32) -> Vec3 {
    // Fractions of the width and half height, and the distance behind the lips' edge, which is the same for all at the
    // end.
    const WAY: [(f32, [f32; 4]); 7] = [
        (0.0, [1.0, 0.0, 0.0, 0.0]),
        (0.12, [1.0, 0.03, 0.25, 0.0]),
        (0.25, [1.03, 0.25, 0.55, 0.0]),
        (0.4, [1.15, 1.45, 0.95, 0.0]),
        (0.55, [1.3, 2.0, 2.2, 0.2]),
        (0.85, [1.3, 1.9, 6.0, 1.0]),
        (1.0, [0.0, 0.0, 6.5, 1.0]),
    ];
    let [width, height, back, end] = curve(&WAY, depth);
    let mouth = (edge.x / HALF_MOUTH).min(1.0);
    let round = (1.0 - mouth * mouth * mouth * mouth).max(0.0).sqrt();
    let z = mix(edge.z - back, 9.0 - back, end);
    let y = mix(edge.y, MOUTH_HEIGHT, (depth * 4.0).min(1.0));
    Vec3::new(edge.x * width, y + above * height * round, z)
}

/// Returns a point of the ear: up from the head behind it, over the rim (helix), across a groove and a second ridge
/// (antihelix), and down into the hollow in front of the ear canal.
fn shell(edge: Vec3, depth: f32) -> Vec3 {
    // Distance from the middle relative to the outline's, and out of the head: at the back and the top, at the front
    // (tragus), at the lobe.
    const WAY: [[f32; 6]; 17] = [
        [0.62, 0.0, 1.0, 0.0, 0.55, 0.0],
        [0.60, 0.3, 1.0, 0.0, 0.66, 0.1],
        [0.62, 0.65, 1.0, 0.0, 0.78, 0.2],
        [0.72, 0.95, 0.99, 0.02, 0.88, 0.3],
        [0.90, 1.15, 0.98, 0.05, 0.97, 0.4],
        [1.03, 1.3, 0.96, 0.1, 1.03, 0.55],
        [1.07, 1.55, 0.93, 0.18, 1.05, 0.75],
        [1.0, 1.75, 0.89, 0.28, 1.0, 0.9],
        [0.90, 1.68, 0.84, 0.4, 0.90, 0.95],
        [0.82, 1.3, 0.78, 0.52, 0.80, 0.9],
        [0.74, 1.22, 0.71, 0.62, 0.70, 0.85],
        [0.64, 1.5, 0.63, 0.66, 0.60, 0.9],
        [0.54, 1.5, 0.54, 0.5, 0.50, 0.95],
        [0.46, 1.0, 0.45, 0.2, 0.42, 0.6],
        [0.38, 0.45, 0.36, 0.1, 0.34, 0.3],
        [0.22, 0.2, 0.20, 0.1, 0.20, 0.2],
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    ];
    let [back, out_back, front, out_front, low, out_low] = spline(&WAY, depth * (WAY.len() - 1) as f32);
    let arm = Vec2::new((edge.z - EAR[1]) / EAR[3], (edge.y - EAR[0]) / EAR[2]);
    let above = arm.y.max(0.0);
    let ahead = smoothstep(-0.1, 0.95, arm.x - 0.3 * above);
    let lobe = smoothstep(-0.3, -1.0, arm.y);
    let scale = mix(mix(back, low, lobe), front, ahead);
    let out = mix(mix(out_back, out_low, lobe), out_front, ahead)
        * (1.0 + 0.45 * above - 0.95 * above * above - 0.15 * arm.y * arm.y);
    // The outline is an egg, wider above and round below, that leans back; in front it is that of the root.
    let round = 1.0 + 0.4 * arm.x * arm.x * arm.y * arm.y;
    let tall = arm.y * mix(if arm.y > 0.0 { 2.85 } else { 2.65 }, EAR[2], ahead) * round;
    let wide = arm.x * if arm.x > 0.0 { EAR[3] } else { 1.95 + 0.2 * arm.y } * round;
    let x = mix(EAR_ROOT, edge.x, scale.min(1.0)) + out;
    let place = Vec3::new(x, EAR[0] + scale * tall, EAR[1] + scale * (wide - 0.16 * tall * (1.0 - ahead)));
    mix3(edge, place, (depth * 8.0).min(1.0))
}
