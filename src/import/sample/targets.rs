//! The targets: the 52 ARKit expressions, then bumps at random places.

use super::{HeadDesc, smoothstep};
use crate::asset::SourceTarget;
use crate::math::Rng;
use glam::Vec3;

/// How a lobe of a target moves the surface; lengths in cm at weight 1.
#[derive(Clone, Copy)]
enum Motion {
    /// The same way everywhere.
    Shift([f32; 3]),
    /// A turn of the jaw about the axis through both ears (radians).
    Jaw(f32),
    /// Away from a point inside the head.
    Puff(f32),
    /// Towards the middle of the mouth and forwards (or, negative, away and back).
    Purse(f32, f32),
}

/// A part of a target: where, how far it reaches, what it does.
#[derive(Clone, Copy)]
struct Lobe {
    centre: Vec3,
    radii: Vec3,
    motion: Motion,
}

/// Which sides of the face a row of the table is about.
#[derive(Clone, Copy, PartialEq)]
enum Side {
    Middle,
    /// A target for the left side and one for the right.
    Each,
    /// One target that moves both sides.
    Both,
}

use Motion::{Jaw, Puff, Purse, Shift};
use Side::{Both, Each, Middle};

/// Name, sides, centre and radii (of the left side), motion, and the size of its support relative to others.
type Row = (&'static str, Side, [f32; 3], [f32; 3], Motion, f32);

const EYE: [f32; 3] = [3.15, 1.05, 8.2];
const LID: [f32; 3] = [3.15, 1.65, 8.3];
const LOWER_LID: [f32; 3] = [3.15, 0.35, 8.2];
const MOUTH: [f32; 3] = [0.0, -5.1, 9.6];
const CORNER: [f32; 3] = [2.6, -5.0, 8.4];
const JAW: [f32; 3] = [0.0, -8.2, 7.2];

/// The target that real heads leave empty.
pub(super) const EMPTY: &str = "tongueOut";

/// Rows about the eyes.
const EYES: usize = 7;

/// Apple's blend shape locations; first those of the eyes.
const ARKIT: [Row; 32] = [
    ("eyeBlink", Each, LID, [1.5, 0.7, 1.5], Shift([0.0, -1.0, 0.15]), 0.6),
    ("eyeLookDown", Each, EYE, [1.1, 0.8, 1.2], Shift([0.0, -0.35, 0.0]), 0.5),
    ("eyeLookIn", Each, EYE, [1.0, 0.7, 1.2], Shift([-0.3, 0.0, 0.0]), 0.4),
    ("eyeLookOut", Each, EYE, [1.0, 0.7, 1.2], Shift([0.3, 0.0, 0.0]), 0.4),
    ("eyeLookUp", Each, EYE, [1.1, 0.8, 1.2], Shift([0.0, 0.35, 0.0]), 0.5),
    ("eyeSquint", Each, LOWER_LID, [1.9, 0.9, 1.5], Shift([0.0, 0.45, 0.1]), 0.8),
    ("eyeWide", Each, LID, [1.5, 0.8, 1.5], Shift([0.0, 0.4, -0.05]), 0.6),
    ("jawForward", Middle, JAW, [5.0, 3.2, 6.0], Shift([0.0, -0.1, 1.1]), 2.4),
    ("jaw", Each, JAW, [5.0, 3.2, 6.0], Shift([1.1, 0.0, 0.0]), 2.4),
    ("jawOpen", Middle, JAW, [5.5, 3.6, 6.5], Jaw(0.34), 3.0),
    ("mouthClose", Middle, MOUTH, [2.6, 1.3, 2.0], Shift([0.0, 0.7, 0.0]), 1.2),
    ("mouthFunnel", Middle, MOUTH, [2.6, 1.9, 2.5], Purse(0.25, 0.8), 1.4),
    ("mouthPucker", Middle, MOUTH, [2.8, 1.7, 2.5], Purse(0.42, 0.6), 1.4),
    ("mouth", Each, MOUTH, [3.2, 1.8, 2.5], Shift([0.8, 0.0, 0.0]), 1.6),
    ("mouthSmile", Each, CORNER, [1.8, 1.7, 2.5], Shift([0.6, 0.9, -0.35]), 1.3),
    ("mouthFrown", Each, CORNER, [1.6, 1.6, 2.5], Shift([0.2, -0.8, -0.1]), 1.1),
    ("mouthDimple", Each, CORNER, [1.2, 1.2, 2.0], Shift([0.4, 0.1, -0.5]), 0.9),
    ("mouthStretch", Each, CORNER, [1.7, 1.5, 2.5], Shift([0.8, -0.3, -0.4]), 1.2),
    ("mouthRollLower", Middle, [0.0, -5.7, 9.8], [2.4, 0.8, 2.0], Shift([0.0, 0.35, -0.6]), 0.9),
    ("mouthRollUpper", Middle, [0.0, -4.5, 9.8], [2.4, 0.8, 2.0], Shift([0.0, -0.35, -0.6]), 0.9),
    ("mouthShrugLower", Middle, [0.0, -6.2, 9.4], [2.6, 1.3, 2.0], Shift([0.0, 0.6, 0.35]), 1.2),
    ("mouthShrugUpper", Middle, [0.0, -4.4, 9.6], [2.6, 1.0, 2.0], Shift([0.0, 0.5, 0.3]), 1.1),
    ("mouthPress", Each, [1.3, -5.1, 9.4], [1.6, 0.9, 2.0], Shift([0.0, 0.15, -0.35]), 0.9),
    ("mouthLowerDown", Each, [1.2, -5.8, 9.4], [1.5, 1.0, 2.0], Shift([0.1, -0.7, -0.1]), 1.0),
    ("mouthUpperUp", Each, [1.2, -4.4, 9.4], [1.5, 1.0, 2.0], Shift([0.1, 0.65, 0.1]), 1.0),
    ("browDown", Each, [2.6, 2.9, 8.9], [2.2, 1.2, 2.0], Shift([-0.25, -0.6, 0.1]), 0.9),
    ("browInnerUp", Both, [1.3, 3.2, 9.1], [1.5, 1.5, 2.0], Shift([0.1, 0.8, 0.05]), 1.3),
    ("browOuterUp", Each, [4.4, 3.1, 7.9], [1.8, 1.4, 2.0], Shift([0.1, 0.75, 0.0]), 0.9),
    ("cheekPuff", Both, [4.3, -4.6, 6.5], [2.2, 2.2, 2.8], Puff(1.1), 2.0),
    ("cheekSquint", Each, [4.2, -0.7, 7.7], [2.0, 1.4, 2.0], Shift([0.1, 0.55, 0.3]), 1.0),
    ("noseSneer", Each, [1.3, -1.6, 9.7], [1.1, 1.4, 1.5], Shift([0.1, 0.5, 0.1]), 0.8),
    (EMPTY, Middle, [0.0, -5.3, 9.6], [1.6, 0.7, 1.5], Shift([0.0, -0.3, 0.9]), 1.0),
];

/// Name, what moves, and the size of its support relative to others.
type Expression = (String, Vec<Lobe>, f32);

/// Apple's blend shapes in Apple's order: the left eye, the right eye, and then each left side before its right.
fn arkit() -> Vec<Expression> {
    let make = |&(name, side, centre, radii, motion, support): &Row, suffix: &str| {
        let left = Lobe { centre: Vec3::from(centre), radii: Vec3::from(radii), motion };
        let mirrored = if let Shift([x, y, z]) = motion { Shift([-x, y, z]) } else { motion };
        let right = Lobe { centre: left.centre * Vec3::new(-1.0, 1.0, 1.0), motion: mirrored, ..left };
        let lobes = match side {
            Both => vec![left, right],
            Each if suffix == "Right" => vec![right],
            Middle | Each => vec![left],
        };
        (format!("{name}{suffix}"), lobes, support)
    };
    let suffixes = |row: &Row| if row.1 == Each { &["Left", "Right"][..] } else { &[""] };
    let (eyes, rest) = ARKIT.split_at(EYES);
    let eyes = ["Left", "Right"].into_iter().flat_map(|suffix| eyes.iter().map(move |row| make(row, suffix)));
    let rest = rest.iter().flat_map(|row| suffixes(row).iter().map(move |suffix| make(row, suffix)));
    eyes.chain(rest).collect()
}

/// The names of the first `count` targets.
pub(super) fn names(count: usize) -> Vec<String> {
    let arkit = arkit();
    let details = (arkit.len()..count).map(|i| format!("detail_{:03}", i + 1));
    arkit.iter().map(|e| e.0.clone()).chain(details).take(count).collect()
}

/// A bump at a random vertex, mostly outwards or inwards; and its relative support.
fn detail(rng: &mut Rng, positions: &[Vec3]) -> (Vec<Lobe>, f32) {
    let centre = positions[rng.below(positions.len())];
    let radii = Vec3::splat(rng.range(0.8, 2.6));
    let outward = (centre - Vec3::new(0.0, centre.y * 0.5, -1.0)).normalize_or(Vec3::Z);
    let any = Vec3::new(rng.range(-1.0, 1.0), rng.range(-1.0, 1.0), rng.range(-1.0, 1.0));
    let strength = rng.range(0.2, 0.7) * if rng.unit() < 0.3 { -1.0 } else { 1.0 };
    let motion = Shift(((outward + 0.7 * any).normalize_or(Vec3::Z) * strength).to_array());
    (vec![Lobe { centre, radii, motion }], rng.range(0.5, 1.5))
}

impl Lobe {
    /// The displacement of `p`, without regard to the target's support.
    fn displacement(&self, p: Vec3) -> Vec3 {
        let q = ((p - self.centre) / self.radii).length_squared();
        // A long, faint tail: a real target's influence fades, it does not stop at the feature.
        let core = 0.04 + 0.96 / ((1.0 + q) * (1.0 + q));
        core * match self.motion {
            Shift(d) => Vec3::from(d),
            Jaw(angle) => {
                // The upper jaw stays: only what is below the line between the lips turns.
                let below = 0.03 + 0.97 * smoothstep(-4.9, -5.4, p.y);
                let arm = p - Vec3::new(0.0, -0.5, -0.5); // from the hinge between the ears
                angle * below * Vec3::new(0.0, -arm.z - 0.5, arm.y)
            }
            Puff(length) => length * (p - Vec3::new(p.x * 0.3, p.y, 3.0)).normalize_or(Vec3::Z),
            Purse(narrow, forward) => Vec3::new(-narrow * p.x, -0.5 * narrow * (p.y - self.centre.y), forward),
        }
    }
}

/// All targets of the head with the base pose `positions`.
pub(super) fn targets(desc: &HeadDesc, positions: &[Vec3]) -> Vec<SourceTarget> {
    let mut arkit = arkit().into_iter();
    let part = |(i, name): (usize, String)| {
        // A stream each: a target does not depend on how many others there are.
        let mut rng = Rng::new(desc.seed, i as u64);
        let (lobes, support) = arkit.next().map_or_else(|| detail(&mut rng, positions), |e| (e.1, e.2));
        // Heads of different seeds differ a little in the size of every support.
        let support = support * rng.range(0.9, 1.1);
        let support = if name == EMPTY && desc.sparsity < 1.0 { 0.0 } else { support };
        (name, lobes, support)
    };
    let parts: Vec<Expression> = names(desc.targets).into_iter().enumerate().map(part).collect();
    let factors: Vec<f32> = parts.iter().map(|part| part.2).collect();
    let target = |((name, lobes, _), fraction): (Expression, f32)| SourceTarget {
        name,
        positions: if fraction > 0.0 { moved(&lobes, fraction, positions) } else { Vec::new() },
        ..SourceTarget::default()
    };
    parts.into_iter().zip(fractions(&factors, desc.sparsity)).map(target).collect()
}

/// Fractions in the ratio of `factors`, none above 1, with the mean `wanted` (or as near as that allows).
fn fractions(factors: &[f32], wanted: f32) -> Vec<f32> {
    if wanted >= 1.0 {
        return vec![1.0; factors.len()];
    }
    let goal = wanted * factors.len() as f32;
    let mut scale = goal / factors.iter().sum::<f32>().max(f32::MIN_POSITIVE);
    // The others share what exceeds a full target.
    for _ in 0..64 {
        let (full, rest): (Vec<f32>, Vec<f32>) = factors.iter().copied().partition(|f| f * scale >= 1.0);
        let rest: f32 = rest.iter().sum();
        if rest > 0.0 {
            scale = ((goal - full.len() as f32) / rest).max(scale);
        }
    }
    factors.iter().map(|f| (f * scale).min(1.0)).collect()
}

/// The deltas of the `fraction` of the vertices that are nearest to a lobe's centre.
fn moved(lobes: &[Lobe], fraction: f32, positions: &[Vec3]) -> Vec<(u32, Vec3)> {
    let count = positions.len();
    let wanted = ((f64::from(fraction) * count as f64).ceil() as usize).clamp(1, count);
    let distance = |p: &Vec3| lobes.iter().map(|l| (*p - l.centre).length_squared()).fold(f32::INFINITY, f32::min);
    let mut nearest: Vec<(f32, u32)> = positions.iter().map(distance).zip(0..).collect();
    // The index breaks ties, so that the choice is the same everywhere.
    let by_distance = |a: &(f32, u32), b: &(f32, u32)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
    // The support ends where the first vertex outside lies; with none outside, well beyond the last one inside.
    let edge = if wanted < count {
        nearest.select_nth_unstable_by(wanted, by_distance).1.0
    } else {
        nearest.iter().map(|n| n.0).fold(0.0, f32::max) * 1.5
    };
    nearest.truncate(wanted);
    nearest.sort_unstable_by_key(|n| n.1);
    // What a vertex inside moves at least: 20 µm, some 500 times less than the target, but more than noise.
    const LEAST: f32 = 2e-3;
    nearest
        .into_iter()
        .map(|(distance, v)| {
            let p = positions[v as usize];
            let fade = if edge > 0.0 { (1.0 - distance / edge).max(0.0) } else { 1.0 };
            let sum: Vec3 = lobes.iter().map(|l| l.displacement(p)).sum();
            let delta = sum * fade * fade;
            let floor = LEAST * if wanted < count { fade.min(0.05) * 20.0 } else { 1.0 };
            let length = delta.length();
            (v, snapped(p, if length >= floor { delta } else { sum.normalize_or(Vec3::Z) * floor }))
        })
        .filter(|(_, d)| *d != Vec3::ZERO)
        .collect()
}

/// `delta` as it comes back from a file that states `base + delta`: a head that was written out and imported is
/// the built-in one, bit for bit.
fn snapped(base: Vec3, delta: Vec3) -> Vec3 {
    // The difference is rounded too; where that moves the sum, it is taken once more.
    (0..5).fold(delta, |delta, _| (base + delta) - base)
}
