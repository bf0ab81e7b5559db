//! The base pose: rows of vertices around a profile curve, and the features of a face pushed out of them.

use super::smoothstep;
use crate::asset::{Corner, Faces, MorphSource};
use glam::{Vec2, Vec3};

/// Cross-sections from the crown to the end of the neck: height, half width, front and back (all cm).
const SECTIONS: [[f32; 4]; 22] = [
    [12.0, 0.0, -0.9, -0.9],
    [11.7, 2.4, 2.0, -4.0],
    [10.8, 4.5, 4.6, -6.7],
    [9.2, 6.1, 6.7, -8.7],
    [7.2, 7.1, 8.0, -9.9],
    [5.0, 7.5, 8.6, -10.4],
    [3.2, 7.5, 8.7, -10.3],
    [1.6, 7.3, 8.3, -9.9],
    [0.0, 7.1, 8.3, -9.2],
    [-2.0, 6.8, 8.4, -8.2],
    [-4.0, 6.4, 8.5, -7.3],
    [-5.5, 6.05, 8.5, -6.7],
    [-7.0, 5.6, 8.2, -6.3],
    [-8.6, 4.8, 7.9, -6.1],
    [-10.0, 4.3, 7.0, -6.0],
    [-10.8, 4.0, 5.2, -6.1],
    [-11.4, 4.1, 3.2, -6.2],
    [-12.4, 4.3, 2.0, -6.3],
    [-14.0, 4.6, 1.7, -6.6],
    [-16.0, 5.2, 2.0, -7.2],
    [-16.5, 4.6, 1.4, -6.6],
    [-16.6, 0.0, -2.6, -2.6],
];

/// The section at `t` in 0..=21, by a Catmull-Rom spline.
fn section(t: f32) -> [f32; 4] {
    let last = SECTIONS.len() - 1;
    let i = (t as usize).min(last - 1);
    let x = t - i as f32;
    let knot = |k: isize| SECTIONS[(i as isize + k).clamp(0, last as isize) as usize];
    let (a, b, c, d) = (knot(-1), knot(0), knot(1), knot(2));
    let mut s = [0.0; 4];
    for k in 0..4 {
        let linear = (c[k] - a[k]) * x;
        let square = (2.0 * a[k] - 5.0 * b[k] + 4.0 * c[k] - d[k]) * x * x;
        let cube = (3.0 * b[k] - a[k] - 3.0 * c[k] + d[k]) * x * x * x;
        s[k] = b[k] + 0.5 * (linear + square + cube);
    }
    s[1] = s[1].max(0.0);
    s
}

/// How much denser rows and columns are at a height: the face has most of the vertices.
fn density(y: f32) -> f32 {
    1.0 + 1.2 * smoothstep(-10.5, -8.0, y) * smoothstep(5.5, 3.0, y)
}

/// Sine of an angle in [−π, π], as a polynomial (see the module head).
fn sin(x: f64) -> f64 {
    use std::f64::consts::{FRAC_PI_2, PI};
    let x = if x.abs() > FRAC_PI_2 { PI.copysign(x) - x } else { x };
    let q = x * x;
    let series = [1.0 / 6227020800.0, -1.0 / 39916800.0, 1.0 / 362880.0, -1.0 / 5040.0, 1.0 / 120.0, -1.0 / 6.0, 1.0];
    x * series.into_iter().fold(0.0, |sum, c| sum * q + c)
}

fn cos(x: f64) -> f64 {
    sin(std::f64::consts::FRAC_PI_2 - x.abs())
}

/// Where each row lies on the profile (in knots), and how many vertices it has.
fn rows(vertices: usize) -> Vec<(f32, usize)> {
    const SAMPLES: usize = 1024;
    let at = |i: usize| section(i as f32 * (SECTIONS.len() - 1) as f32 / SAMPLES as f32);
    // The length of the profile, counted by density.
    let mut lengths = vec![0.0f32];
    let mut around = 0.0;
    for i in 0..SAMPLES {
        let (a, b) = (at(i), at(i + 1));
        let step = Vec3::new(b[0] - a[0], b[1] - a[1], 0.5 * (b[2] - b[3] - a[2] + a[3])).length();
        lengths.push(lengths[i] + step * density(b[0]));
        around += girth(&b) / SAMPLES as f32;
    }
    let total = lengths[SAMPLES];
    let ideal = (vertices as f32 * total / around).sqrt() as usize;
    let count = ideal.clamp(1, (vertices - 2) / 3);

    let place = |r: usize| {
        let wanted = total * r as f32 / (count + 1) as f32;
        let i = lengths.partition_point(|&length| length < wanted).clamp(1, SAMPLES) - 1;
        let part = (wanted - lengths[i]) / (lengths[i + 1] - lengths[i]);
        (i as f32 + part.clamp(0.0, 1.0)) * (SECTIONS.len() - 1) as f32 / SAMPLES as f32
    };
    let places: Vec<f32> = (1..=count).map(place).collect();
    // Three vertices each; the rest by girth, with running sums so that nothing is lost to rounding.
    let weights: Vec<f64> = places.iter().map(|&t| f64::from(girth(&section(t)))).collect();
    let (sum, rest) = (weights.iter().sum::<f64>(), vertices - 2 - 3 * count);
    let (mut running, mut given) = (0.0, 0);
    let mut rows = Vec::with_capacity(count);
    for (r, (&t, w)) in places.iter().zip(&weights).enumerate() {
        running += w;
        let until = if r + 1 == count { rest } else { ((rest as f64 * running / sum) as usize).min(rest) };
        rows.push((t, 3 + until - given));
        given = until;
    }
    rows
}

/// The girth of a section, counted by density.
fn girth(s: &[f32; 4]) -> f32 {
    let depth = 0.5 * (s[2] - s[3]);
    6.3 * ((s[1] * s[1] + depth * depth) * 0.5).sqrt() * density(s[0]).sqrt()
}

/// A point of row `t`, `u` in 0..1 of the way around, from the back over the head's right and the face.
fn point(t: f32, u: f64) -> Vec3 {
    use std::f64::consts::PI;
    let [y, half, front, back] = section(t);
    let a = 2.0 * PI * (u - 0.5);
    // Denser at the face.
    let angle = a - 0.4 * sin(a);
    let (s, c) = (sin(angle) as f32, cos(angle) as f32);
    // A section is widest behind its middle: at the ears, and at the corners of the jaw.
    let middle = back + 0.44 * (front - back);
    let reach = if c > 0.0 { front - middle } else { middle - back };
    sculpt(Vec3::new(half * s, y, middle + reach * c), c, half)
}

/// A smooth bump: 1 at the centre, 0 from the ellipse of the given radii on.
fn bump(x: f32, y: f32, centre: [f32; 2], radii: [f32; 2]) -> f32 {
    let (dx, dy) = ((x - centre[0]) / radii[0], (y - centre[1]) / radii[1]);
    let q = (1.0 - dx * dx - dy * dy).max(0.0);
    q * q
}

/// Push the features of a face out of the plain head. `facing` is 1 at the front, −1 at the back.
fn sculpt(p: Vec3, facing: f32, half: f32) -> Vec3 {
    let side = p.x.abs();
    let y = p.y;
    let front = smoothstep(0.05, 0.45, facing);
    let at = |centre: [f32; 2], radii: [f32; 2]| bump(side, y, centre, radii);
    let mut out = 0.0;

    // Brow ridge and temples, cheekbones and the hollow under them.
    out += 0.5 * at([2.9, 3.0], [3.6, 1.6]) - 0.55 * at([7.0, 3.8], [2.6, 3.2]);
    out += 0.65 * at([4.6, -0.9], [3.0, 2.4]) - 0.55 * at([4.9, -4.8], [2.4, 3.0]);
    // Sockets; in each an eyeball, with the gap between the lids as a line across it.
    out -= 1.25 * at([3.1, 1.2], [2.7, 2.1]) + 0.5 * at([1.5, 1.6], [1.3, 1.6]);
    let ball = at([3.15, 1.05], [1.75, 1.25]);
    out += 1.45 * ball;
    let lids = 1.05 + 0.42 * at([3.15, 1.05], [1.8, 3.0]);
    let opening = at([3.15, 1.05], [1.6, 9.0]);
    out -= 0.42 * opening * (bump(0.0, y, [0.0, lids], [1.0, 0.17]) + bump(0.0, y, [0.0, 2.1 - lids], [1.0, 0.17]));
    out -= 0.22 * at([3.15, 2.2], [2.0, 0.35]);
    // Iris, just a dimple.
    out -= 0.16 * at([3.15, 1.05], [0.5, 0.5]);

    // Nose: a ridge that grows from the bridge to the tip, then wings and nostrils.
    let along = smoothstep(3.2, -2.0, y);
    let under = smoothstep(-3.1, -2.25, y);
    let width = 0.85 + 0.75 * along;
    let across = (1.0 - (side / width) * (side / width)).max(0.0);
    out += (0.5 + 2.0 * along * along) * smoothstep(4.0, 2.0, y) * under * across * across.sqrt();
    out += 0.75 * at([1.25, -2.05], [0.85, 0.85]) - 0.7 * at([0.6, -2.75], [0.45, 0.4]);

    // Mouth: the muzzle, two lips with the line between them, the groove under the nose and the one over the chin.
    out += 0.7 * at([0.0, -5.0], [3.8, 3.0]);
    out -= 0.25 * at([0.0, -3.5], [0.5, 0.9]);
    let bow = 0.16 * at([0.75, -4.4], [0.9, 9.0]);
    out += 0.6 * at([0.0, -4.5 + bow], [2.8, 0.95]) + 0.65 * at([0.0, -5.75], [2.5, 1.1]);
    let line = 1.0 - smoothstep(2.2, 2.75, side);
    out -= 0.5 * line * bump(0.0, y, [0.0, -5.1 + 0.05 * side], [1.0, 0.3]);
    out -= 0.2 * at([2.75, -5.05], [0.8, 0.9]) + 0.4 * at([0.0, -7.0], [2.6, 1.0]);
    out += 0.8 * at([0.0, -8.7], [2.6, 2.1]);

    // Depth mostly, and a little sideways where the surface turns.
    let turn = if half > 0.0 { p.x / half } else { 0.0 };
    let mut p = p + front * out * Vec3::new(0.35 * turn * turn * turn, 0.0, 1.0);

    // Ears: a flap that stands off, hollow in front.
    let z = p.z + 1.6 + 0.18 * (y - 0.2);
    let flap = bump(z, y, [0.0, 0.0], [2.3, 3.7]);
    let hollow = bump(z, y, [0.45, 0.1], [1.0, 2.0]);
    let beside = smoothstep(0.75, 0.95, if half > 0.0 { side / half } else { 0.0 });
    p.x += p.x.signum() * beside * (1.7 * smoothstep(0.0, 0.5, flap) * smoothstep(-1.9, 1.2, -z) - 0.7 * hollow);
    p.z -= beside * 0.6 * flap;
    p
}

/// A head of exactly `vertices` vertices, without targets.
pub(super) fn base(vertices: usize) -> MorphSource {
    if vertices < 5 {
        return few(vertices);
    }
    let last = SECTIONS.len() - 1;
    // Crown and end of the neck are rows of one vertex, with no edges.
    let rows: Vec<(f32, usize)> = [(0.0, 0)].into_iter().chain(rows(vertices)).chain([(last as f32, 0)]).collect();
    let (top, bottom) = (SECTIONS[0][0], SECTIONS[last][0]);
    let (mut positions, mut texcoords) = (Vec::with_capacity(vertices), Vec::new());
    // First vertex and first texture coordinate of each row; a row has one texture coordinate more than
    // edges, the seam at the back being there with u = 0 and u = 1.
    let mut starts = Vec::with_capacity(rows.len());
    for &(t, n) in &rows {
        starts.push((positions.len() as u32, texcoords.len() as u32));
        // The spline ends a rounding error above the last section.
        let v = if t < last as f32 { (section(t)[0] - bottom) / (top - bottom) } else { 0.0 };
        for i in 0..=n {
            let u = if n == 0 { 0.5 } else { i as f64 / n as f64 };
            texcoords.push(Vec2::new(u as f32, v));
            if i < n.max(1) {
                positions.push(point(t, u));
            }
        }
    }

    let mut corners = Vec::with_capacity(6 * vertices);
    let on = |row: usize, i: usize| {
        let ((v, vt), n) = (starts[row], rows[row].1);
        Corner { position: v + (i % n.max(1)) as u32, texcoord: Some(vt + i as u32) }
    };
    for r in 1..rows.len() {
        // Sew two rows together, always stepping on the row of which less is sewn.
        let (above, below) = (rows[r - 1].1, rows[r].1);
        let (mut i, mut j) = (0, 0);
        while i < above || j < below {
            if j == below || (i < above && (i + 1) * below <= (j + 1) * above) {
                corners.extend([on(r - 1, i), on(r, j), on(r - 1, i + 1)]);
                i += 1;
            } else {
                corners.extend([on(r - 1, i), on(r, j), on(r, j + 1)]);
                j += 1;
            }
        }
    }
    let faces = Faces { sizes: vec![3; corners.len() / 3], corners };
    MorphSource { positions, texcoords, faces, ..Default::default() }
}

/// One to four vertices: points of the face's outline, with one face where there are three or more.
fn few(vertices: usize) -> MorphSource {
    let outline =
        [Vec3::new(-5.0, 4.0, 8.0), Vec3::new(0.0, -9.0, 9.0), Vec3::new(5.0, 4.0, 8.0), Vec3::new(0.0, 11.0, 4.0)];
    let positions = outline[..vertices].to_vec();
    let texcoords = positions.iter().map(|p| Vec2::new(0.5 + p.x / 20.0, (p.y + 16.6) / 28.6)).collect();
    let sizes = if vertices < 3 { vec![] } else { vec![vertices as u32] };
    let corners = sizes.iter().flat_map(|&n| 0..n).map(|i| Corner { position: i, texcoord: Some(i) }).collect();
    MorphSource { positions, texcoords, faces: Faces { sizes, corners }, ..Default::default() }
}
