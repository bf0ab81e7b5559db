//! What moves while a configuration is verified and timed: random changes, or a captured clip.

use deltamorph::BoundClip;

/// Weights of every head in every frame. The same whatever path, batch size or format they are applied with.
pub trait Workload {
    /// "random", or the clip's name.
    fn name(&self) -> &str;
    /// Frames after which the result is compared with the reference.
    fn checkpoints(&self) -> Vec<usize>;
    /// The weights of `head` in `frame`. Frames are asked for from 0 on, in order.
    fn weights(&self, head: u32, frame: usize) -> Vec<f32>;
    /// Frames after which it starts over; timing runs on from there.
    fn period(&self) -> usize;
}

/// In each frame `changed` targets, drawn afresh, get a new weight in (0, 1]; the others keep theirs. The
/// last frame is followed by the first, which is no exception.
pub struct Random {
    /// `[frame][target]`.
    frames: Vec<Vec<f32>>,
}

/// Frames of random weights before they repeat.
const RANDOM_FRAMES: usize = 128;
/// Frames before the first comparison with the reference: enough for each slot to have been source and target.
const RANDOM_CHECKS: [usize; 2] = [2, 9];

/// PCG-like step: a number for each call, the same on every machine.
fn next(state: &mut u64) -> u64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    let x = *state ^ (*state >> 33);
    x.wrapping_mul(0xff51_afd7_ed55_8ccd) >> 20
}

impl Random {
    /// `changed` of `targets` per frame, from `seed`.
    pub fn new(targets: usize, changed: usize, seed: u64) -> Self {
        let mut pick = seed.rotate_left(17) ^ 0xD1B5_4A32_D192_ED03;
        let mut order: Vec<usize> = (0..targets).collect();
        let mut draw = |_| {
            for i in 0..changed.min(targets) {
                order.swap(i, i + (next(&mut pick) % (targets - i) as u64) as usize);
            }
            order[..changed.min(targets)].to_vec()
        };
        // Each set comes twice: a target that changed once per round would come back to the weight it has.
        let sets: Vec<Vec<usize>> = (0..RANDOM_FRAMES / 2).map(&mut draw).collect();
        // No two frames share a weight, so a new one is always a change.
        let weight = |state: &mut u64, frame: usize| {
            ((next(state) % 8192) as usize * RANDOM_FRAMES + frame + 1) as f32 / (8192 * RANDOM_FRAMES) as f32
        };
        let seed = seed ^ 0x9E37_79B9_7F4A_7C15;
        let mut state = seed.rotate_left(32);
        let mut now: Vec<f32> = (0..targets).map(|_| weight(&mut state, 0)).collect();
        // The first round only leaves behind the weights that the second one starts from, and ends with.
        let mut frames = vec![];
        for _ in 0..2 {
            frames.clear();
            let mut state = seed;
            for frame in 0..RANDOM_FRAMES {
                for &target in &sets[frame % sets.len()] {
                    now[target] = weight(&mut state, frame);
                }
                frames.push(now.clone());
            }
        }
        Self { frames }
    }
}

impl Workload for Random {
    fn name(&self) -> &str {
        "random"
    }

    fn checkpoints(&self) -> Vec<usize> {
        RANDOM_CHECKS.to_vec()
    }

    fn weights(&self, head: u32, frame: usize) -> Vec<f32> {
        // Heads run through the same frames, each from another one on.
        self.frames[(frame + head as usize * 37) % self.frames.len()].clone()
    }

    fn period(&self) -> usize {
        self.frames.len()
    }
}

/// A few targets that get a new weight in every frame, while all others are 0. Each head has its own few.
pub struct Few {
    targets: usize,
    /// Of the few.
    weights: Random,
    first: usize,
}

/// How far the few of a head are from those of the head before it; prime to most numbers of targets.
const HEAD_STRIDE: usize = 13;

impl Few {
    /// `active` of `targets`, from `seed`.
    pub fn new(targets: usize, active: usize, seed: u64) -> Self {
        let active = active.min(targets);
        let mut state = seed ^ 0xA076_1D64_78BD_642F;
        Self { targets, weights: Random::new(active, active, seed), first: next(&mut state) as usize % targets.max(1) }
    }
}

impl Workload for Few {
    fn name(&self) -> &str {
        "few"
    }

    fn checkpoints(&self) -> Vec<usize> {
        self.weights.checkpoints()
    }

    fn weights(&self, head: u32, frame: usize) -> Vec<f32> {
        let few = self.weights.weights(head, frame);
        let mut all = vec![0.0; self.targets];
        for (i, weight) in few.iter().enumerate() {
            // Spread over the face: neighbours in the list move neighbouring vertices.
            let place = self.first + head as usize * HEAD_STRIDE + i * self.targets / few.len();
            all[place % self.targets] = *weight;
        }
        all
    }

    fn period(&self) -> usize {
        self.weights.period()
    }
}

/// A captured clip, from beginning to end.
pub struct Clip(BoundClip);

/// Frames of a clip at which the result is compared with the reference, the last one among them.
const CLIP_CHECKS: usize = 16;

impl Clip {
    /// `clip`, which has at least one frame.
    pub fn new(clip: BoundClip) -> Self {
        Self(clip)
    }
}

impl Workload for Clip {
    fn name(&self) -> &str {
        &self.0.name
    }

    fn checkpoints(&self) -> Vec<usize> {
        let last = self.0.frame_count() - 1;
        let mut frames: Vec<usize> = (1..=CLIP_CHECKS).map(|i| last * i / CLIP_CHECKS).collect();
        frames.dedup();
        frames
    }

    fn weights(&self, head: u32, frame: usize) -> Vec<f32> {
        self.0.frame((frame + head as usize * 7) % self.0.frame_count())
    }

    fn period(&self) -> usize {
        self.0.frame_count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltamorph::WeightClip;

    #[test]
    fn just_as_many_targets_change_as_asked_for() {
        for changed in [0, 1, 8, 72] {
            let random = Random::new(72, changed, 3);
            // Two rounds: across the seam, wherever a head starts.
            for (head, frame) in [0, 1, 5].into_iter().flat_map(|h| (1..2 * RANDOM_FRAMES).map(move |f| (h, f))) {
                let (a, b) = (random.weights(head, frame - 1), random.weights(head, frame));
                assert_eq!(a.iter().zip(&b).filter(|(a, b)| a != b).count(), changed, "head {head}, frame {frame}");
                assert!(b.iter().all(|w| (0.0..=1.0).contains(w) && *w > 0.0));
            }
        }
        assert_eq!(Random::new(72, 8, 3).frames, Random::new(72, 8, 3).frames);
        assert_ne!(Random::new(72, 8, 3).frames, Random::new(72, 8, 4).frames);
        assert!(Random::new(0, 0, 1).weights(0, 5).is_empty());
    }

    #[test]
    fn few_targets_are_active_and_all_of_them_change() {
        for (targets, active) in [(72, 4), (12, 4), (3, 4), (4, 4)] {
            let few = Few::new(targets, active, 3);
            for (head, frame) in [0, 1, 7].into_iter().flat_map(|h| (1..2 * RANDOM_FRAMES).map(move |f| (h, f))) {
                let (a, b) = (few.weights(head, frame - 1), few.weights(head, frame));
                let (places, expected) = (b.iter().filter(|w| **w != 0.0).count(), active.min(targets));
                let changed = a.iter().zip(&b).filter(|(a, b)| a != b).count();
                assert_eq!((b.len(), places, changed), (targets, expected, expected), "head {head}, frame {frame}");
            }
        }
        assert!(Few::new(0, 4, 3).weights(2, 1).is_empty());
        let few = Few::new(72, 4, 3);
        let active = |head| few.weights(head, 0).iter().map(|w| *w != 0.0).collect::<Vec<_>>();
        assert_ne!(active(0), active(1));
    }

    #[test]
    fn a_clip_is_checked_at_its_end() {
        let captured = WeightClip { names: vec!["a".into()], values: vec![0.5; 335], ..Default::default() };
        let clip = Clip::new(captured.bind(&["a", "b"]).expect("a column that names a target"));
        assert_eq!((clip.checkpoints().len(), clip.checkpoints().last()), (16, Some(&334)));
        assert_eq!(clip.weights(0, 335), [0.5, 0.0]);
    }
}
