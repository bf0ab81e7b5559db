//! Weights while a configuration is verified and timed: random changes or a captured clip, on any number of instances.

use deltamorph::{BoundClip, WeightClip};
use deltamorph_head::Rng;
use deltamorph_headless::Draws;
use std::ops::Range;

/// Weights of every instance in every frame. Independent of path, batch size and format.
pub struct Workload {
    /// "random", "few", or the clip's name.
    pub name: String,
    /// Targets that change per frame and instance, as requested; `None` for clips.
    pub changed: Option<usize>,
    /// Frames after which the result is compared with the reference.
    pub checkpoints: Vec<usize>,
    /// `[frame][target]` of the first instance, repeated.
    frames: Vec<Vec<f32>>,
    /// Frames that an instance is ahead of the one before it, so that no two are in step.
    ahead: usize,
    /// Targets that the weights of an instance are rotated by, relative to the one before it.
    turned: usize,
}

/// Frames of random weights before they repeat.
const RANDOM_FRAMES: usize = 128;
/// Frames before the first comparisons with the reference: each slot has been source and target.
const RANDOM_CHECKS: [usize; 2] = [2, 9];
/// Frames of a clip at which the result is compared with the reference, the last one among them.
const CLIP_CHECKS: usize = 16;
/// Frames per second of a clip that the device plays: a power of two, so that frames lie on ticks of its clock.
const CLIP_FPS: f32 = 32.0;
/// Distance of the few targets of an instance from those of the one before it; coprime to most numbers of targets.
const HEAD_STRIDE: usize = 13;

impl Workload {
    /// A cycle of frames: each gives `changed` targets, drawn from `seed`, a new weight in (0, 1]; the others keep
    /// theirs. This includes the first frame, which follows the last.
    pub fn random(targets: usize, changed: usize, seed: u64) -> Self {
        let mut pick = Rng::new(seed, 0);
        let mut order: Vec<usize> = (0..targets).collect();
        let mut draw = |_| {
            for i in 0..changed.min(targets) {
                order.swap(i, i + pick.below(targets - i));
            }
            order[..changed.min(targets)].to_vec()
        };
        // Each set comes twice: a target that changed once per round would return to its own weight.
        let sets: Vec<Vec<usize>> = (0..RANDOM_FRAMES / 2).map(&mut draw).collect();
        // No two frames share a weight: a new one is always a change.
        let weight = |rng: &mut Rng, frame: usize| {
            (rng.below(8192) * RANDOM_FRAMES + frame + 1) as f32 / (8192 * RANDOM_FRAMES) as f32
        };
        let mut rng = Rng::new(seed, 1);
        let mut now: Vec<f32> = (0..targets).map(|_| weight(&mut rng, 0)).collect();
        // The first round determines the weights that the second one starts and ends with.
        let mut frames = vec![];
        for _ in 0..2 {
            frames.clear();
            let mut rng = Rng::new(seed, 2);
            for frame in 0..RANDOM_FRAMES {
                for &target in &sets[frame % sets.len()] {
                    now[target] = weight(&mut rng, frame);
                }
                frames.push(now.clone());
            }
        }
        let checkpoints = RANDOM_CHECKS.to_vec();
        Self { name: "random".into(), changed: Some(changed), checkpoints, frames, ahead: 37, turned: 0 }
    }

    /// `active` of `targets`, different ones for each instance, get a new weight in every frame, and `held` of the
    /// others have a weight in (0, 1] that never changes; the rest are 0.
    pub fn few(targets: usize, active: usize, held: usize, seed: u64) -> Self {
        let active = active.min(targets);
        let mut rng = Rng::new(seed, 3);
        let first = rng.below(targets.max(1));
        let (name, moving) = ("few".into(), Self::random(active, active, seed));
        // Spread over the face: targets next to each other in the list move neighbouring vertices.
        let places: Vec<usize> = (0..active).map(|i| (first + i * targets / active) % targets).collect();
        let free: Vec<usize> = (0..targets).filter(|target| !places.contains(target)).collect();
        let held = held.min(free.len());
        let mut still = vec![0.0; targets];
        (0..held).for_each(|i| still[free[i * free.len() / held]] = (rng.below(8192) + 1) as f32 / 8192.0);
        let all = |frame: &Vec<f32>| {
            let mut all = still.clone();
            places.iter().zip(frame).for_each(|(&place, weight)| all[place] = *weight);
            all
        };
        Self { name, turned: HEAD_STRIDE, frames: moving.frames.iter().map(all).collect(), ..moving }
    }

    /// All frames of `clip`, at least one.
    pub fn clip(clip: &BoundClip) -> Self {
        let last = clip.frame_count() - 1;
        let mut checkpoints: Vec<usize> = (1..=CLIP_CHECKS).map(|i| last * i / CLIP_CHECKS).collect();
        checkpoints.dedup();
        let (name, frames) = (clip.name.clone(), clip.frames().collect());
        Self { name, changed: None, checkpoints, frames, ahead: 7, turned: 0 }
    }

    pub fn weights(&self, head: u32, frame: usize) -> Vec<f32> {
        self.turn(self.frames[(frame + head as usize * self.ahead) % self.frames.len()].clone(), head)
    }

    fn turn(&self, mut weights: Vec<f32>, head: u32) -> Vec<f32> {
        let turned = head as usize * self.turned % weights.len().max(1);
        weights.rotate_right(turned);
        weights
    }

    /// The largest absolute weight.
    pub fn largest(&self) -> f32 {
        self.frames.iter().flatten().fold(0.0, |most, weight| most.max(weight.abs()))
    }

    /// Its frames as clips of all targets, without their names: as many as are different among those of `heads`, which
    /// play them in turns.
    pub fn as_clips(&self, heads: Range<u32>) -> Vec<WeightClip> {
        let targets = self.frames[0].len();
        let different = if self.turned == 0 { 1 } else { targets.clamp(1, heads.len()) };
        let clip = |head| {
            let turned = |frame: &Vec<f32>| self.turn(frame.clone(), head);
            let values = self.frames.iter().flat_map(turned).collect();
            WeightClip { name: self.name.clone(), fps: CLIP_FPS, values, ..WeightClip::default() }
        };
        heads.take(different).map(clip).collect()
    }

    /// Frames that an instance is ahead of the one before it.
    pub fn ahead(&self) -> usize {
        self.ahead
    }

    /// Frames before it repeats; timing continues past the end.
    pub fn period(&self) -> usize {
        self.frames.len()
    }
}

/// The conditions of a measurement, except the configuration.
#[derive(Clone, Copy)]
pub struct Setting<'a> {
    /// A workload for each mesh, at least one; each for as many instances.
    pub workloads: &'a [Workload],
    /// Number of instances, of all meshes together: each with its own weights, unless `shared`.
    pub heads: u32,
    /// One animation: one instance of each mesh is updated, and its pose drawn for all.
    pub shared: bool,
    /// Passes that draw each instance after the update of every frame, without rasterizing: the last one reads whole
    /// vertices, those before it positions alone.
    pub passes: u32,
    /// Compares with the reference after a few frames instead of all checkpoints of the workload, if frames take long.
    pub brief: bool,
}

impl Setting<'_> {
    /// The workload of the first mesh.
    pub fn first(&self) -> &Workload {
        &self.workloads[0]
    }

    pub fn updated(&self) -> u32 {
        if self.shared { self.workloads.len() as u32 } else { self.heads }
    }

    /// The draws of updated instances in `passes`.
    pub fn draws(&self, passes: u32) -> Draws {
        Draws { copies: self.heads / self.updated(), passes }
    }

    /// Updated instances of each mesh.
    pub fn each(&self) -> u32 {
        self.updated() / self.workloads.len() as u32
    }

    /// The weights of each updated instance: those of the first mesh, then those of the next.
    pub fn weights(&self, frame: usize) -> Vec<Vec<f32>> {
        let each = self.each();
        let of_mesh = |(part, own): (u32, &Workload)| -> Vec<_> {
            (part * each..(part + 1) * each).map(|head| own.weights(head, frame)).collect()
        };
        (0..).zip(self.workloads).flat_map(of_mesh).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn just_as_many_targets_change_and_are_active_as_asked_for() {
        let all = |changed| (Workload::random(72, changed, 3), changed, 72);
        let few = |targets, active: usize| (Workload::few(targets, 4, 0, 3), active, active);
        let held = |targets, held, changed, all| (Workload::few(targets, changed, held, 3), changed, all);
        let few = [few(72, 4), few(12, 4), few(3, 3), few(4, 4)];
        let held = [held(72, 28, 4, 32), held(72, 28, 0, 28), held(72, 0, 0, 0), held(12, 28, 4, 12), held(3, 2, 3, 3)];
        let cases = [all(0), all(1), all(8), all(72)].into_iter().chain(few).chain(held);
        for (work, changed, active) in cases {
            // Two rounds: across the seam for every instance.
            for (head, frame) in [0, 1, 5, 7].into_iter().flat_map(|h| (1..2 * RANDOM_FRAMES).map(move |f| (h, f))) {
                let (a, b) = (work.weights(head, frame - 1), work.weights(head, frame));
                let found = a.iter().zip(&b).filter(|(a, b)| a != b).count();
                let places = b.iter().filter(|w| **w > 0.0).count();
                assert_eq!((found, places), (changed, active), "{}, head {head}, frame {frame}", work.name);
                assert!(b.iter().all(|w| (0.0..=1.0).contains(w)));
            }
        }
        assert_eq!(Workload::random(72, 8, 3).frames, Workload::random(72, 8, 3).frames);
        assert_ne!(Workload::random(72, 8, 3).frames, Workload::random(72, 8, 4).frames);
        let few = Workload::few(72, 4, 0, 3);
        let active = |head| few.weights(head, 0).iter().map(|w| *w != 0.0).collect::<Vec<_>>();
        assert_ne!(active(0), active(1));
        for none in [Workload::random(0, 0, 1), Workload::few(0, 4, 0, 3)] {
            assert!(none.weights(2, 5).is_empty());
        }
    }

    #[test]
    fn a_clip_is_checked_at_its_end() {
        let captured = WeightClip { names: vec!["a".into()], values: vec![0.5; 335], ..Default::default() };
        let clip = Workload::clip(&captured.bind(&["a", "b"]).expect("a column that names a target"));
        assert_eq!((clip.checkpoints.len(), clip.checkpoints.last()), (16, Some(&334)));
        assert_eq!(clip.weights(0, 335), [0.5, 0.0]);
    }
}
