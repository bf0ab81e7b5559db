//! The targets: the 52 ARKit expressions, then bumps at random places.

use super::motion::Motion::{self, Jaw, Look, Puff, Purse, Shift, Tongue};
use super::motion::{Lip, Lobe, clear_of_eyes};
use super::spot::{Part, Slit, Spot};
use super::{HeadDesc, Rng};
use deltamorph::glam::Vec3;
use deltamorph::mesh::MorphTarget;
#[cfg(feature = "threads")]
use rayon::prelude::*;

/// The sides of the face that a row of the table describes.
#[derive(Clone, Copy, PartialEq)]
enum Side {
    Middle,
    /// A target for the left side and one for the right.
    Each,
    /// One target that moves both sides.
    Both,
}

use Side::{Both, Each, Middle};

/// Name, sides, relative size of the support, and the lobes on the left side or in the middle.
type Row = (&'static str, Side, f32, &'static [Lobe]);

const fn at(centre: [f32; 3], radii: [f32; 3], motion: Motion) -> Lobe {
    Lobe { centre: Vec3::from_array(centre), radii: Vec3::from_array(radii), motion, lip: Lip::Both }
}

const fn upper(centre: [f32; 3], radii: [f32; 3], motion: Motion) -> Lobe {
    Lobe { lip: Lip::Upper, ..at(centre, radii, motion) }
}

const fn lower(centre: [f32; 3], radii: [f32; 3], motion: Motion) -> Lobe {
    Lobe { lip: Lip::Lower, ..at(centre, radii, motion) }
}

/// Makes a lobe whose motion defines its own position.
const fn lids(open: f32, lower: f32) -> Lobe {
    at([3.15, 1.0, 8.3], [1.5, 0.8, 1.5], Motion::Lids(open, lower))
}

const fn look(out: f32, up: f32) -> Lobe {
    at([3.15, 1.0, 8.1], [1.0, 1.0, 1.0], Look(out, up))
}

const fn jaw(open: f32, shift: [f32; 3]) -> Lobe {
    at([0.0, -8.2, 7.2], [5.0, 3.2, 6.0], Jaw(open, shift))
}

const MOUTH: [f32; 3] = [0.0, -5.4, 9.4];
const CORNER: [f32; 3] = [2.6, -5.4, 8.4];
const UPPER_LIP: [f32; 3] = [0.0, -4.9, 9.8];
const LOWER_LIP: [f32; 3] = [0.0, -5.9, 9.8];

/// Number of rows for the eyes.
const EYES: usize = 7;

/// Apple's blend shape locations, beginning with those of the eyes.
const ARKIT: [Row; 32] = [
    ("eyeBlink", Each, 0.7, &[lids(0.0, 0.75)]),
    ("eyeLookDown", Each, 0.7, &[look(0.0, -0.42), lids(0.55, 1.05)]),
    ("eyeLookIn", Each, 0.5, &[look(-0.5, 0.0)]),
    ("eyeLookOut", Each, 0.5, &[look(0.5, 0.0)]),
    ("eyeLookUp", Each, 0.7, &[look(0.0, 0.36), lids(1.25, 1.0)]),
    ("eyeSquint", Each, 0.8, &[lids(0.52, 0.35), at([3.3, -0.7, 8.3], [1.9, 0.9, 1.5], Shift([0.0, 0.35, 0.1]))]),
    ("eyeWide", Each, 0.7, &[lids(1.5, 1.15), at([3.15, 2.6, 8.9], [1.9, 0.8, 1.5], Shift([0.0, 0.25, 0.0]))]),
    ("jawForward", Middle, 2.4, &[jaw(0.0, [0.0, -0.1, 0.8])]),
    ("jaw", Each, 2.4, &[jaw(0.02, [0.9, 0.0, 0.0])]),
    ("jawOpen", Middle, 3.0, &[jaw(0.3, [0.0, 0.0, 0.6]), at(MOUTH, [3.2, 2.4, 2.6], Purse(0.2, 0.1))]),
    ("mouthClose", Middle, 1.2, &[at(MOUTH, [2.6, 1.1, 2.0], Shift([0.0, 0.28, -0.1]))]),
    (
        "mouthFunnel",
        Middle,
        1.4,
        &[
            at(MOUTH, [2.6, 1.7, 2.5], Purse(0.32, 0.7)),
            upper(UPPER_LIP, [2.2, 1.0, 2.0], Shift([0.0, 0.4, 0.15])),
            lower(LOWER_LIP, [2.2, 1.0, 2.0], Shift([0.0, -0.5, 0.15])),
        ],
    ),
    ("mouthPucker", Middle, 1.4, &[at(MOUTH, [3.2, 1.6, 2.6], Purse(0.45, 0.9))]),
    ("mouth", Each, 1.6, &[at(MOUTH, [4.5, 2.0, 3.5], Shift([0.8, 0.0, 0.0]))]),
    (
        "mouthSmile",
        Each,
        1.3,
        &[
            at(CORNER, [1.8, 1.5, 2.5], Shift([0.5, 0.8, -0.4])),
            at([4.3, -2.6, 7.8], [1.8, 1.5, 2.0], Shift([0.15, 0.4, 0.35])),
        ],
    ),
    ("mouthFrown", Each, 1.1, &[at(CORNER, [1.4, 1.3, 2.5], Shift([0.15, -0.8, -0.15]))]),
    ("mouthDimple", Each, 0.9, &[at(CORNER, [1.1, 1.1, 2.0], Shift([0.45, 0.12, -0.5]))]),
    ("mouthStretch", Each, 1.2, &[at(CORNER, [1.7, 1.5, 2.5], Shift([0.8, -0.35, -0.45]))]),
    ("mouthRollLower", Middle, 0.9, &[lower(LOWER_LIP, [2.4, 0.6, 2.0], Shift([0.0, 0.12, -0.5]))]),
    ("mouthRollUpper", Middle, 0.9, &[upper(UPPER_LIP, [2.4, 0.6, 2.0], Shift([0.0, -0.1, -0.5]))]),
    ("mouthShrugLower", Middle, 1.2, &[at([0.0, -6.3, 9.4], [2.6, 1.3, 2.0], Shift([0.0, 0.6, 0.3]))]),
    ("mouthShrugUpper", Middle, 1.1, &[at([0.0, -4.6, 9.6], [2.6, 0.9, 2.0], Shift([0.0, 0.45, 0.3]))]),
    ("mouthPress", Each, 0.9, &[at([1.5, -5.4, 9.3], [1.5, 0.8, 2.0], Shift([0.15, 0.1, -0.35]))]),
    ("mouthLowerDown", Each, 1.0, &[lower([1.2, -5.7, 9.4], [1.9, 1.0, 2.0], Shift([0.15, -0.75, -0.1]))]),
    ("mouthUpperUp", Each, 1.0, &[upper([1.2, -5.1, 9.4], [1.8, 1.0, 2.0], Shift([0.15, 0.7, 0.1]))]),
    ("browDown", Each, 0.9, &[at([2.4, 3.0, 8.9], [2.2, 1.1, 2.0], Shift([-0.25, -0.45, 0.1]))]),
    ("browInnerUp", Both, 1.3, &[at([1.2, 3.0, 9.1], [1.6, 1.2, 2.0], Shift([0.0, 0.6, 0.05]))]),
    ("browOuterUp", Each, 0.9, &[at([4.3, 3.1, 7.9], [1.6, 1.1, 2.0], Shift([0.1, 0.75, 0.0]))]),
    ("cheekPuff", Both, 2.0, &[at([4.4, -4.6, 6.9], [2.7, 2.6, 3.4], Puff(1.0))]),
    ("cheekSquint", Each, 1.0, &[at([4.0, -1.0, 8.0], [2.0, 1.2, 2.0], Shift([0.1, 0.6, 0.35])), lids(0.8, 0.7)]),
    ("noseSneer", Each, 0.8, &[at([1.3, -2.0, 9.7], [1.0, 1.2, 1.5], Shift([0.1, 0.75, 0.1]))]),
    ("tongueOut", Middle, 2.0, &[jaw(0.17, [0.0, 0.0, 0.3]), at(MOUTH, [1.0, 1.0, 1.0], Tongue(4.2, 0.8))]),
];

/// A target before its support is known.
struct Expression {
    name: String,
    lobes: Vec<Lobe>,
    /// The lobes apply to the left side, and to the right side.
    sides: [bool; 2],
    support: f32,
    /// Seed of its random numbers; the targets of a left and right pair share it.
    stream: u64,
}

/// Apple's blend shapes in Apple's order: the left eye, the right eye, and then each left side before its right.
fn arkit() -> Vec<Expression> {
    let make = |stream: usize, suffix: &str| {
        let (name, side, support, lobes) = ARKIT[stream];
        let sides = [suffix != "Right", side == Both || suffix == "Right"];
        Expression { name: format!("{name}{suffix}"), lobes: lobes.to_vec(), sides, support, stream: stream as u64 }
    };
    let suffixes = |row: usize| if ARKIT[row].1 == Each { &["Left", "Right"][..] } else { &[""] };
    let eyes = ["Left", "Right"].into_iter().flat_map(|suffix| (0..EYES).map(move |row| make(row, suffix)));
    let rest = (EYES..ARKIT.len()).flat_map(|row| suffixes(row).iter().map(move |suffix| make(row, suffix)));
    eyes.chain(rest).collect()
}

/// Returns the names of the first `count` targets.
pub fn names(count: usize) -> Vec<String> {
    let arkit = arkit();
    let details = (arkit.len()..count).map(|i| format!("detail_{:03}", i + 1));
    arkit.iter().map(|e| e.name.clone()).chain(details).take(count).collect()
}

/// Makes a bump at a random place of the skin, mostly outwards or inwards.
fn detail(seed: u64, i: usize, spots: &[Spot], positions: &[Vec3]) -> Expression {
    let rng = &mut Rng::new(seed, i as u64);
    let mut v = rng.below(positions.len());
    while spots[v].part != Part::Skin || matches!(spots[v].behind, Some((Slit::Eye | Slit::Mouth, _))) {
        v = rng.below(positions.len());
    }
    let centre = positions[v];
    let radii = Vec3::splat(rng.range(0.8, 2.6));
    let outward = (centre - Vec3::new(0.0, centre.y * 0.5, -1.0)).normalize_or(Vec3::Z);
    let any = Vec3::new(rng.range(-1.0, 1.0), rng.range(-1.0, 1.0), rng.range(-1.0, 1.0));
    let strength = rng.range(0.1, 0.3) * radii.x * if rng.unit() < 0.3 { -1.0 } else { 1.0 };
    let motion = Shift(((outward + 0.7 * any).normalize_or(Vec3::Z) * strength).to_array());
    let lobes = vec![Lobe { centre, radii, motion, lip: Lip::Both }];
    Expression {
        name: String::new(),
        lobes,
        sides: [true, false],
        support: rng.range(0.5, 1.5),
        stream: 1 << 33 | i as u64,
    }
}

/// Makes all targets of the head with the base pose `positions`.
pub fn targets(desc: &HeadDesc, spots: &[Spot], positions: &[Vec3]) -> Vec<MorphTarget> {
    let mut arkit = arkit().into_iter();
    let part = |(i, name): (usize, String)| {
        // A random stream for each target, so that it does not depend on the number of others.
        let found = arkit.next().unwrap_or_else(|| detail(desc.seed, i, spots, positions));
        // Heads of different seeds differ slightly in the size of every support.
        let support = found.support * Rng::new(desc.seed, found.stream).range(0.9, 1.1);
        Expression { name, support, ..found }
    };
    let parts: Vec<Expression> = names(desc.targets).into_iter().enumerate().map(part).collect();
    let factors: Vec<f32> = parts.iter().map(|part| part.support).collect();
    let fractions = fractions(&factors, desc.sparsity);
    let parts: Vec<(Expression, f32)> = parts.into_iter().zip(fractions).collect();
    let target = |(part, fraction): (Expression, f32)| MorphTarget {
        positions: part.moved(fraction, spots, positions),
        name: part.name,
        ..MorphTarget::default()
    };
    #[cfg(feature = "threads")]
    let parts = parts.into_par_iter();
    #[cfg(not(feature = "threads"))]
    let parts = parts.into_iter();
    parts.map(target).collect()
}

/// Returns fractions in the ratio of `factors`, none above 1, with the mean `wanted` (or as near as that allows).
fn fractions(factors: &[f32], wanted: f32) -> Vec<f32> {
    if wanted >= 1.0 {
        return vec![1.0; factors.len()];
    }
    let goal = wanted * factors.len() as f32;
    let mut scale = goal / factors.iter().sum::<f32>().max(f32::MIN_POSITIVE);
    // The other targets share the excess over a full target.
    for _ in 0..64 {
        let (full, rest): (Vec<f32>, Vec<f32>) = factors.iter().copied().partition(|f| f * scale >= 1.0);
        let rest: f32 = rest.iter().sum();
        if rest > 0.0 {
            scale = ((goal - full.len() as f32) / rest).max(scale);
        }
    }
    factors.iter().map(|f| (f * scale).min(1.0)).collect()
}

/// Smallest displacement of a vertex inside a support: 20 µm, about 500 times less than the target's largest, but more
/// than noise.
const LEAST: f32 = 2e-3;

impl Expression {
    /// Returns the displacement of a vertex regardless of the support, and its closeness to the moving lobes, in (0,
    /// 1].
    fn displacement(&self, spot: &Spot, p: Vec3) -> (Vec3, f32) {
        let (mut sum, mut near) = (Vec3::ZERO, f32::INFINITY);
        for (mirrored, _) in [false, true].into_iter().zip(self.sides).filter(|(_, is)| *is) {
            let flip = Vec3::new(if mirrored { -1.0 } else { 1.0 }, 1.0, 1.0);
            let (spot, q) = (Spot { mirrored: spot.mirrored != mirrored, ..*spot }, p * flip);
            for lobe in &self.lobes {
                sum += lobe.displacement(&spot, q) * flip;
                near = near.min((q - lobe.centre).length_squared());
            }
        }
        let tail = if spot.part == Part::Skin { 1.0 } else { 0.25 };
        (clear_of_eyes(spot, p, sum), tail / (1.0 + 0.1 * near))
    }

    /// Returns the deltas of the `fraction` of the vertices that move most.
    fn moved(&self, fraction: f32, spots: &[Spot], positions: &[Vec3]) -> Vec<(u32, Vec3)> {
        let count = positions.len();
        let wanted = ((f64::from(fraction) * count as f64).ceil() as usize).clamp(1, count);
        let full: Vec<(Vec3, f32)> = spots.iter().zip(positions).map(|(s, p)| self.displacement(s, *p)).collect();
        // The vertices nearest to the lobes follow those that the lobes move.
        let mut most: Vec<(f32, u32)> = full.iter().map(|(d, near)| d.length() + LEAST * near).zip(0..).collect();
        // The index breaks ties, so that the choice is the same everywhere.
        let by_motion = |a: &(f32, u32), b: &(f32, u32)| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1));
        // The support ends at the first vertex outside.
        let edge = if wanted < count { most.select_nth_unstable_by(wanted, by_motion).1.0 } else { 0.0 };
        most.truncate(wanted);
        most.sort_unstable_by_key(|m| m.1);
        most.into_iter()
            .map(|(motion, v)| {
                let p = positions[v as usize];
                let sum = full[v as usize].0;
                let fade = if edge > 0.0 { super::smoothstep(1.0, 3.0, motion / edge) } else { 1.0 };
                let delta = sum * fade;
                let floor = LEAST * if wanted < count { fade.clamp(0.001, 0.05) * 20.0 } else { 1.0 };
                let length = delta.length();
                (v, snapped(p, if length >= floor { delta } else { sum.normalize_or(Vec3::Z) * floor }))
            })
            .filter(|(_, d)| *d != Vec3::ZERO)
            .collect()
    }
}

/// Returns `delta` as read back from a file that states `base + delta`, so that an exported and imported head equals
/// the built-in one bit for bit.
fn snapped(base: Vec3, delta: Vec3) -> Vec3 {
    // The difference is rounded too; if that changes the sum, it is computed once more.
    (0..5).fold(delta, |delta, _| (base + delta) - base)
}
