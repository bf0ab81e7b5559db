//! The rows of the skin: their number and positions, the vertices of each, and the openings.

use super::shape::{self, SECTIONS, section};
use super::spot::Slit;
use super::{EYE, HALF_MOUTH, smoothstep};
use deltamorph::glam::Vec3;
use std::f32::consts::PI;

const SLITS: [Slit; 3] = [Slit::Eye, Slit::Ear, Slit::Mouth];

/// A cumulative length along a parameter from 0 to 1, to position rows and vertices by density.
pub struct Gauge(Vec<f32>);

impl Gauge {
    const SAMPLES: usize = 512;

    fn new(step: impl Fn(f32, f32) -> f32) -> Self {
        let mut sums = vec![0.0f32];
        for i in 0..Self::SAMPLES {
            let at = |i: usize| i as f32 / Self::SAMPLES as f32;
            sums.push(sums[i] + step(at(i), at(i + 1)).max(1e-4));
        }
        Self(sums)
    }

    fn total(&self) -> f32 {
        self.0[Self::SAMPLES]
    }

    /// Returns the length at `x`.
    fn length(&self, x: f32) -> f32 {
        let at = x.clamp(0.0, 1.0) * Self::SAMPLES as f32;
        let i = (at as usize).min(Self::SAMPLES - 1);
        self.0[i] + (at - i as f32) * (self.0[i + 1] - self.0[i])
    }

    /// Returns the position at which the length is `wanted`.
    fn at(&self, wanted: f32) -> f32 {
        let i = self.0.partition_point(|&length| length < wanted).clamp(1, Self::SAMPLES) - 1;
        let part = (wanted - self.0[i]) / (self.0[i + 1] - self.0[i]);
        (i as f32 + part.clamp(0.0, 1.0)) / Self::SAMPLES as f32
    }

    /// Returns the indices of the positions `pins` (ascending) among `count` steps, the last of which may be half a
    /// step.
    fn pin(&self, pins: &[f32], count: f32, apart: usize) -> Vec<usize> {
        let (mut last, mut indices) = (0, Vec::new());
        for (k, &x) in pins.iter().enumerate() {
            let ideal = (self.length(x) / self.total() * count + 0.5) as usize;
            let room = count - 0.5 - ((pins.len() - 1 - k) * apart) as f32;
            let least = if k == 0 { 1 } else { last + apart };
            last = ideal.min(room as usize).max(least);
            indices.push(last);
        }
        indices
    }

    /// Returns the position of step `i` of `count`, with the steps `indices` at `pins`.
    fn place(&self, i: usize, count: f32, pins: &[f32], indices: &[usize]) -> f32 {
        let (mut from, mut to) = ((0.0, 0.0), (count, self.total()));
        for (&x, &index) in pins.iter().zip(indices) {
            if i == index {
                return x;
            }
            if index < i {
                from = (index as f32, self.length(x));
            } else {
                to = (index as f32, self.length(x));
                break;
            }
        }
        self.at(from.1 + (to.1 - from.1) * (i as f32 - from.0) / (to.0 - from.0))
    }
}

/// Returns the density of rows at a height: eyes, nose and mouth have most of the vertices.
fn row_density(y: f32) -> f32 {
    let face = smoothstep(-10.5, -8.0, y) * smoothstep(5.5, 3.0, y);
    let lids = smoothstep(-1.2, 0.4, y) * smoothstep(2.8, 1.6, y);
    let nostrils = smoothstep(-4.2, -3.4, y) * smoothstep(-1.6, -2.4, y);
    let lips = smoothstep(-7.0, -6.2, y) * smoothstep(-4.0, -4.6, y);
    1.0 + 0.8 * face + 1.6 * lids + 1.8 * nostrils + 1.6 * lips
}

/// Returns the density of columns at a height and an angle from the front.
fn column_density(y: f32, a: f32) -> f32 {
    let front = smoothstep(-11.0, -8.5, y) * smoothstep(6.5, 3.5, y) * smoothstep(1.1, 0.7, a);
    let ear = smoothstep(-6.0, -3.0, y) * smoothstep(5.0, 2.5, y) * smoothstep(0.3, 0.15, (a - 1.59).abs());
    1.0 + 1.5 * front + 3.0 * ear
}

/// Makes half a row, from the back to the front.
fn half_row(t: f32) -> Gauge {
    Gauge::new(|from, to| {
        let at = |x: f32| shape::plain(PI * (1.0 - x), t).0;
        (at(to) - at(from)).length() * column_density(section(t)[0], PI * (1.0 - 0.5 * (from + to)))
    })
}

/// Returns the corners of an opening, as angles from the front, the one further back first. The mouth has one on each
/// side.
fn corners(slit: Slit) -> Vec<f32> {
    let at = |x: f32| angle_of(|p| p.x - x, slit.row(), 0.5 * PI);
    match slit {
        Slit::Eye => vec![at(EYE.x + shape::HALF_EYE), at(EYE.x - shape::HALF_EYE)],
        Slit::Ear => {
            [-1.0, 1.0].map(|c| angle_of(|p| shape::EAR[1] + c * shape::EAR[3] - p.z, slit.row(), PI)).to_vec()
        }
        Slit::Mouth => vec![at(HALF_MOUTH)],
    }
}

/// Returns the angle from the front, below `end`, at which `passed` is 0 along a row.
fn angle_of(passed: impl Fn(Vec3) -> f32, row: f32, end: f32) -> f32 {
    let (mut low, mut high) = (0.0, end);
    for _ in 0..24 {
        let middle = 0.5 * (low + high);
        if passed(shape::plain(middle, row).0) < 0.0 { low = middle } else { high = middle }
    }
    high
}

/// An opening in a row of vertices: the first and the last index.
pub type Span = (Slit, usize, usize);

/// A row of vertices around the head, from the back over its right side and the face.
pub struct Row {
    /// Its position among the sections.
    pub t: f32,
    /// Its vertices, without those on the lower edges of openings.
    pub count: usize,
    pub openings: Vec<Span>,
    gauge: Gauge,
    slit: Option<Slit>,
}

impl Row {
    fn pins(&self) -> Vec<f32> {
        self.slit.map_or_else(Vec::new, |slit| corners(slit).iter().map(|a| 1.0 - a / PI).collect())
    }

    /// Returns the position of each vertex between back (0) and front (1), up to the one in front.
    pub fn places(&self) -> Vec<f32> {
        let (half, pins) = (self.count as f32 * 0.5, self.pins());
        let corners = self
            .openings
            .first()
            .map_or(vec![], |&(slit, from, to)| if slit == Slit::Mouth { vec![from] } else { vec![from, to] });
        let place = |i: usize| if 2 * i == self.count { 1.0 } else { self.gauge.place(i, half, &pins, &corners) };
        (0..=self.count / 2).map(place).collect()
    }

    /// Returns the number of vertices behind its openings and on their lower edges.
    fn extra(&self) -> usize {
        let vertices = |&(slit, from, to): &Span| {
            let around = 2 * (to - from);
            (to - from - 1) + around * slit.rings(around) + 1
        };
        self.openings.iter().map(vertices).sum()
    }

    /// Opens the row at its slit.
    fn open(&mut self) {
        let Some(slit) = self.slit else { return };
        let n = self.count;
        let apart = if slit == Slit::Mouth { 1 } else { 2 };
        self.openings = match self.gauge.pin(&self.pins(), n as f32 * 0.5, apart)[..] {
            [corner] => vec![(slit, corner, n - corner)],
            [outer, inner] => vec![(slit, outer, inner), (slit, n - inner, n - outer)],
            _ => Vec::new(),
        };
    }
}

/// Makes the rows of a skin of exactly `vertices` vertices.
pub fn rows(vertices: usize, features: bool) -> Vec<Row> {
    let last = (SECTIONS.len() - 1) as f32;
    let profile = Gauge::new(|from, to| {
        let (a, b) = (section(from * last), section(to * last));
        let middle = |s: &[f32; 5]| 0.5 * (s[2] - s[3]);
        let (dy, dx, dz) = (b[0] - a[0], b[1] - a[1], middle(&b) - middle(&a));
        (dx * dx + dy * dy + dz * dz).sqrt() * row_density(a[0])
    });
    let girth = |t: f32| half_row(t).total() * 2.0;
    const SAMPLES: usize = 64;
    let around = (0..SAMPLES).map(|i| girth(profile.at(profile.total() * (i as f32 + 0.5) / SAMPLES as f32) * last));
    let around = around.sum::<f32>() / SAMPLES as f32;
    // Approximate number of vertices that the openings take.
    let plain = if features { vertices as f32 * 0.84 } else { vertices as f32 };
    let ideal = (plain * profile.total() / around).sqrt() as usize;
    let count = ideal.clamp(if features { 4 } else { 1 }, (vertices - 2) / 3);
    let slits: &[Slit] = if features { &SLITS } else { &[] };
    let pins: Vec<f32> = slits.iter().map(|s| s.row() / last).collect();
    let indices = profile.pin(&pins, (count + 1) as f32, 1);
    let step = around / (plain / count as f32);
    let least = if features { 4 } else { 3 };
    let mut rows = Vec::with_capacity(count);
    let mut weights = Vec::with_capacity(count);
    for i in 1..=count {
        let t = profile.place(i, (count + 1) as f32, &pins, &indices) * last;
        let slit = indices.iter().position(|&k| k == i).map(|k| slits[k]);
        let t = slit.map_or(t, Slit::row);
        let gauge = half_row(t);
        weights.push(if slit.is_some() { 0.0 } else { f64::from(gauge.total()) });
        let columns = if slit.is_some() { ((gauge.total() / step) as usize).max(6) * 2 } else { least };
        let mut row = Row { t, count: columns, openings: Vec::new(), gauge, slit };
        row.open();
        rows.push(row);
    }
    // Each row gets a few vertices, the rest go by girth. A row keeps the number of the row above while that is about
    // right: continuous columns make a smooth surface. The last row takes the remainder. With an even number there is a
    // vertex both at the back and in front.
    let pair = if features { 2 } else { 1 };
    let rest = vertices - 2 - rows.iter().map(|r| r.count + r.extra()).sum::<usize>();
    let sum = weights.iter().sum::<f64>();
    let (mut running, mut given, mut kept) = (0.0, 0, 0);
    let last_plain = weights.iter().rposition(|w| *w > 0.0).unwrap_or(0);
    for (r, row) in rows.iter_mut().enumerate().filter(|(_, row)| row.slit.is_none()) {
        let ideal = rest as f64 * weights[r] / sum;
        let owed = running - given as f64;
        running += ideal;
        if (ideal + owed - kept as f64).abs() > 2.0 + ideal / 16.0 {
            kept = (ideal + 0.25 * owed).max(0.0) as usize / pair * pair;
        }
        let more = if r == last_plain { rest - given } else { kept.min(rest - given) };
        row.count += more;
        given += more;
    }
    rows
}
