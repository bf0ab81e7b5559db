//! Motions of the head by parts of targets, described for the head's left side (+X) or its middle; points on the right
//! are mirrored before and after.

use super::shape::{LID_RADIUS, Lids};
use super::spot::{Part, Slit, Spot};
use super::{EYE, EYE_RADIUS, HALF_MOUTH, MOUTH_HEIGHT, TONGUE_HEIGHT, cos, mix, place, sin, smoothstep};
use deltamorph::glam::Vec3;

/// The motion of a lobe of a target; lengths in cm and angles in radians at weight 1.
#[derive(Clone, Copy)]
pub enum Motion {
    /// The same displacement everywhere.
    Shift([f32; 3]),
    /// The lower jaw: rotated about the axis through both ears, then shifted.
    Jaw(f32, [f32; 3]),
    /// Away from a point inside the head.
    Puff(f32),
    /// Towards the middle of the mouth and forwards (or, negative, away and back).
    Purse(f32, f32),
    /// The lids of the left eye slide to this opening: see [`Lids`].
    Lids(f32, f32),
    /// The left eyeball turns: outwards, upwards.
    Look(f32, f32),
    /// The tongue comes out, and down at its tip.
    Tongue(f32, f32),
}

use Motion::{Jaw, Look, Puff, Purse, Shift, Tongue};

/// The side of the line between the lips that a lobe applies to.
#[derive(Clone, Copy, PartialEq)]
pub enum Lip {
    Both,
    Upper,
    Lower,
}

/// A part of a target: its centre, its reach, its motion.
#[derive(Clone, Copy)]
pub struct Lobe {
    pub centre: Vec3,
    pub radii: Vec3,
    pub motion: Motion,
    pub lip: Lip,
}

/// Rotates `q` from the first axis towards the second.
fn turned(q: [f32; 2], angle: f32) -> [f32; 2] {
    let (s, c) = (sin(f64::from(angle)) as f32, cos(f64::from(angle)) as f32);
    [q[0] * c - q[1] * s, q[1] * c + q[0] * s]
}

/// Returns the fraction of the jaw's motion that the skin follows.
fn jaw_share(spot: &Spot, p: Vec3) -> f32 {
    let deep = matches!(spot.behind, Some((Slit::Mouth, _)));
    let depth = spot.behind.map_or(0.0, |b| b.1);
    let x = p.x.abs();
    // The line between moved and fixed skin goes from the corner of the mouth up to the ear.
    let line = MOUTH_HEIGHT + 3.5 * smoothstep(8.0, 1.0, p.z);
    let d = if deep { 0.0 } else { spot.height - line };
    let below = d < 0.0 || (spot.t == Slit::Mouth.row() && spot.lower);
    // Deep inside, everything but the sides moves with the teeth.
    let mouth = x / HALF_MOUTH * if deep { mix(1.0, 0.8, smoothstep(0.2, 0.45, depth)) } else { 1.0 };
    let fourth = mouth * mouth * mouth * mouth;
    let inner = (1.0 - if deep { mix(fourth, fourth * fourth, smoothstep(0.2, 0.45, depth)) } else { fourth }).max(0.0);
    // The opening is round at its corners.
    let inner = inner.sqrt();
    let apart = inner.max(smoothstep(0.0, 1.9 + 0.5 * (x - HALF_MOUTH).max(0.0), d.abs()));
    let share = 0.5 + 0.5 * if below { apart } else { -apart };
    if deep {
        return mix(share, 0.5, smoothstep(0.87, 1.0, depth));
    }
    share * smoothstep(-1.0, 4.5, p.z) * smoothstep(-13.5, -10.0, p.y)
}

impl Lobe {
    /// Returns the displacement of the vertex `spot` at `p`.
    pub fn displacement(&self, spot: &Spot, p: Vec3) -> Vec3 {
        let skin = spot.part == Part::Skin;
        match self.motion {
            Motion::Lids(open, lower) => {
                let near = skin && !spot.mirrored && (p - EYE).length_squared() < 16.0;
                let rest = |lids: Lids| place(spot, lids);
                if near { rest(Lids { open, lower }) - rest(Lids::REST) } else { Vec3::ZERO }
            }
            Look(out, up) if spot.part == Part::Eye && !spot.mirrored => {
                let q = p - EYE;
                let [z, x] = turned([q.z, q.x], out);
                let [z, y] = turned([z, q.y], up);
                Vec3::new(x, y, z) - q
            }
            Jaw(angle, shift) => {
                let share = match spot.part {
                    Part::Skin => jaw_share(spot, p),
                    Part::LowerTeeth | Part::Tongue => 1.0,
                    Part::Eye | Part::UpperTeeth => 0.0,
                };
                let arm = p - Vec3::new(p.x, -1.0, -0.5); // from the hinge between the ears
                let [y, z] = turned([arm.y, arm.z], angle * share);
                Vec3::new(0.0, y - arm.y, z - arm.z) + Vec3::from(shift) * share
            }
            Tongue(out, down) if spot.part == Part::Tongue => {
                let ahead = smoothstep(3.4, 7.0, p.z);
                let z = p.z + out * ahead * ahead;
                // Over the teeth and the lip, then down; thinner and narrower on the way.
                let lift = 0.95 * smoothstep(5.2, 7.2, z) - down * smoothstep(9.4, 11.0, z);
                Vec3::new(-0.2 * p.x * ahead, lift - 0.35 * (p.y - TONGUE_HEIGHT) * ahead, z - p.z)
            }
            Look(..) | Tongue(..) => Vec3::ZERO,
            Shift(_) | Puff(_) | Purse(..) if !skin => Vec3::ZERO,
            Shift(d) => Vec3::from(d) * self.core(spot, p),
            Puff(length) => length * self.core(spot, p) * (p - Vec3::new(p.x * 0.3, p.y, 3.0)).normalize_or(Vec3::Z),
            Purse(narrow, forward) => {
                let towards = Vec3::new(-narrow * p.x, -0.5 * narrow * (p.y - self.centre.y), forward);
                towards * self.core(spot, p)
            }
        }
    }

    /// Returns 1 at the centre, with a long, faint tail: a real target's influence fades beyond the feature.
    fn core(&self, spot: &Spot, p: Vec3) -> f32 {
        let q = ((p - self.centre) / self.radii).length_squared();
        let mut core = 1.0 / ((1.0 + q) * (1.0 + q));
        if self.lip != Lip::Both {
            // Lips part only towards the middle; points on the other side stay.
            let mouth = p.x.abs() / HALF_MOUTH;
            let part = (1.0 - mouth * mouth).max(0.0);
            let deep = matches!(spot.behind, Some((Slit::Mouth, _)));
            let d = if deep { 0.0 } else { spot.height - MOUTH_HEIGHT };
            let below = d < 0.0 || (spot.t == Slit::Mouth.row() && spot.lower);
            let mine = below == (self.lip == Lip::Lower);
            core *= if mine { mix(part, 1.0, smoothstep(0.0, 1.5, d.abs())) } else { 0.0 };
        }
        match spot.behind {
            // The inside of the lips follows; deeper points stay at the teeth.
            Some((Slit::Mouth, depth)) => core * smoothstep(0.4, 0.12, depth),
            Some((Slit::Eye, depth)) => core * (1.0 - depth) * 0.1,
            _ => core * (1.0 - 0.9 * lid_zone(p)),
        }
    }
}

/// Returns 1 on the lids, 0 away from them.
fn lid_zone(p: Vec3) -> f32 {
    let (x, y) = ((p.x.abs() - EYE.x) / 2.3, (p.y - EYE.y) / 1.9);
    if p.z < EYE.z - 1.0 { 0.0 } else { smoothstep(1.0, 0.35, x * x + y * y) }
}

/// Returns the displacement `delta` of the skin at `p`, changed if needed to stay out of the eyeballs.
pub fn clear_of_eyes(spot: &Spot, p: Vec3, delta: Vec3) -> Vec3 {
    let eye = if p.x < 0.0 { Vec3::new(-EYE.x, EYE.y, EYE.z) } else { EYE };
    let least = (p - eye).length().min(LID_RADIUS);
    let moved = p + delta - eye;
    let length = moved.length();
    if spot.part != Part::Skin || length >= least || length < 0.5 * EYE_RADIUS {
        return delta;
    }
    eye + moved * (least / length) - p
}
