//! The net: rows of vertices from crown to neck that open at eyes, ears and mouth, rings of vertices behind these
//! openings, and closed surfaces for eyeballs, teeth and tongue.

use super::parts;
use super::rows::rows;
use super::shape::{SECTIONS, section};
use super::spot::{Part, Slit, Spot};
use deltamorph::glam::Vec2;
use deltamorph::mesh::Corner;
use std::f32::consts::PI;

/// Returns a spot on the outside of the skin.
fn on_skin(a: f32, t: f32) -> Spot {
    Spot { part: Part::Skin, mirrored: false, a, t, height: section(t)[0], lower: false, behind: None }
}

/// Vertices, texture coordinates and faces, without positions.
#[derive(Default)]
pub struct Net {
    pub spots: Vec<Spot>,
    pub texcoords: Vec<Vec2>,
    pub corners: Vec<Corner>,
}

/// A row for sewing: vertex, texture coordinate and net position of each point, those at the seam twice.
struct Thread(Vec<(u32, u32, f32)>);

impl Net {
    /// Makes a net of exactly `vertices` vertices (≥ 5).
    pub fn new(vertices: usize) -> Self {
        let mut net = Self::default();
        // Smaller heads have only the outline of a face.
        let features = vertices >= 250;
        let parts = if features { parts::counts(vertices) } else { Vec::new() };
        net.skin(vertices - parts.iter().map(|p| p.2).sum::<usize>(), features);
        for &(part, mirrored, count) in &parts {
            net.closed(part, mirrored, count);
        }
        net
    }

    fn texcoord(&mut self, u: f32, v: f32) -> u32 {
        self.texcoords.push(Vec2::new(u, v));
        self.texcoords.len() as u32 - 1
    }

    fn vertex(&mut self, spot: Spot) -> u32 {
        self.spots.push(spot);
        self.spots.len() as u32 - 1
    }

    fn face(&mut self, points: [(u32, u32); 3]) {
        self.corners.extend(points.map(|(position, texcoord)| Corner { position, texcoord: Some(texcoord) }));
    }

    /// Adds a row of one vertex, without edges.
    fn pole(&mut self, spot: Spot, u: f32, v: f32) -> Thread {
        Thread(vec![(self.vertex(spot), self.texcoord(u, v), 0.5)])
    }

    fn skin(&mut self, vertices: usize, features: bool) {
        let (top, bottom) = (SECTIONS[0][0], SECTIONS[SECTIONS.len() - 1][0]);
        // The lowest part of the texture is for the surfaces behind the openings.
        let v = |t: f32| 0.25 + 0.75 * ((section(t)[0] - bottom) / (top - bottom)).max(0.0);
        let mut above = self.pole(on_skin(0.0, 0.0), 0.5, v(0.0));
        let mut strip = 0;
        for row in rows(vertices, features) {
            let n = row.count;
            let places = row.places();
            let mut upper: Vec<(u32, u32, f32)> = Vec::with_capacity(n + 1);
            for i in 0..=n {
                let x = places[i.min(n - i)];
                let place = if 2 * i > n { 1.0 - 0.5 * x } else { 0.5 * x };
                let texcoord = self.texcoord(i as f32 / n as f32, v(row.t));
                let vertex = if i == n {
                    upper[0].0
                } else {
                    self.vertex(Spot { mirrored: 2 * i < n, ..on_skin(PI * (1.0 - x), row.t) })
                };
                upper.push((vertex, texcoord, place));
            }
            let mut lower = upper.clone();
            for &(slit, from, to) in &row.openings {
                for point in &mut lower[from + 1..to] {
                    point.0 = self.vertex(Spot { lower: true, ..self.spots[point.0 as usize] });
                }
                let edge: Vec<u32> =
                    upper[from..=to].iter().map(|p| p.0).chain(lower[from + 1..to].iter().rev().map(|p| p.0)).collect();
                self.rings(slit, &edge, strip);
                strip += 1;
            }
            let upper = Thread(upper);
            self.sew(&above, &upper, false);
            above = Thread(lower);
        }
        let last = (SECTIONS.len() - 1) as f32;
        let end = self.pole(on_skin(0.0, last), 0.5, v(last));
        self.sew(&above, &end, false);
    }

    /// Adds the surfaces behind the opening with the edge `edge`: rings that end in a point.
    fn rings(&mut self, slit: Slit, edge: &[u32], strip: usize) {
        let n = edge.len();
        let count = slit.rings(n);
        // The inside of the mouth shares the tongue's tile.
        let u0 = if slit == Slit::Mouth { parts::tile(Part::Tongue) } else { 0.0 };
        let v = |depth: f32| 0.005 + 0.05 * strip as f32 + 0.04 * depth;
        let line = |net: &mut Self, ring: &[u32], depth: f32| {
            let points = (0..=n).map(|k| (ring[k % n], net.texcoord(u0 + k as f32 / n as f32, v(depth)), 0.0));
            points.collect::<Vec<_>>()
        };
        let mut outer = line(self, edge, 0.0);
        for r in 1..=count {
            let depth = r as f32 / (count + 1) as f32;
            let mut ring = Vec::with_capacity(n);
            for &e in edge {
                ring.push(self.vertex(Spot { behind: Some((slit, depth)), ..self.spots[e as usize] }));
            }
            let inner = line(self, &ring, depth);
            for k in 0..n {
                let point = |line: &[(u32, u32, f32)], k: usize| (line[k].0, line[k].1);
                self.face([point(&outer, k + 1), point(&outer, k), point(&inner, k)]);
                self.face([point(&outer, k + 1), point(&inner, k), point(&inner, k + 1)]);
            }
            outer = inner;
        }
        // The last point is the same from each vertex of the edge.
        let end = self.vertex(Spot { behind: Some((slit, 1.0)), ..self.spots[edge[n / 4] as usize] });
        let texcoord = self.texcoord(u0 + 0.5, v(1.0));
        for k in 0..n {
            self.face([(outer[k + 1].0, outer[k + 1].1), (outer[k].0, outer[k].1), (end, texcoord)]);
        }
    }

    /// Adds a closed surface of rows around an axis, with exactly `vertices` (≥ 5) vertices, in its own texture tile.
    fn closed(&mut self, part: Part, mirrored: bool, vertices: usize) {
        let spot = |a: f32, t: f32| Spot { part, mirrored, a, t, height: 0.0, lower: false, behind: None };
        let u0 = parts::tile(part);
        let flipped = mirrored != matches!(part, Part::Eye | Part::UpperTeeth);
        let rest = vertices - 2;
        let count = ((rest as f32 * parts::aspect(part)).sqrt() as usize).clamp(1, rest / 3);
        let mut above = self.pole(spot(0.0, 0.0), u0 + 0.5, 0.0);
        for r in 1..=count {
            let n = rest * r / count - rest * (r - 1) / count;
            let t = r as f32 / (count + 1) as f32;
            let mut row: Vec<(u32, u32, f32)> = Vec::with_capacity(n + 1);
            for i in 0..=n {
                // The two sides mirror each other bit for bit.
                let half = i.min(n - i) as f32 / n as f32;
                let place = i as f32 / n as f32;
                let texcoord = self.texcoord(u0 + place, t);
                let vertex = match row.first() {
                    Some(&(first, ..)) if i == n => first,
                    _ => self.vertex(spot(if 2 * i > n { -half } else { half }, t)),
                };
                row.push((vertex, texcoord, place));
            }
            let row = Thread(row);
            self.sew(&above, &row, flipped);
            above = row;
        }
        let end = self.pole(spot(0.0, 1.0), u0 + 0.5, 1.0);
        self.sew(&above, &end, flipped);
    }

    /// Sews two rows together, always advancing on the row whose next point comes first.
    fn sew(&mut self, above: &Thread, below: &Thread, flipped: bool) {
        let (a, b) = (&above.0, &below.0);
        let (mut i, mut j) = (0, 0);
        let mut face = |x: (u32, u32, f32), y: (u32, u32, f32), z: (u32, u32, f32)| {
            let (y, z) = if flipped { (z, y) } else { (y, z) };
            self.face([x, y, z].map(|p| (p.0, p.1)));
        };
        while i + 1 < a.len() || j + 1 < b.len() {
            let next = |row: &[(u32, u32, f32)], i: usize| row[i].2 + row[i + 1].2;
            if j + 1 == b.len() || (i + 1 < a.len() && next(a, i) <= next(b, j)) {
                face(a[i], b[j], a[i + 1]);
                i += 1;
            } else {
                face(a[i], b[j], b[j + 1]);
                j += 1;
            }
        }
    }
}
