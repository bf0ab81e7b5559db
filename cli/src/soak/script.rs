//! What a soak runs: alternating stretches of random and of captured frames.

use deltamorph::BoundClip;
use deltamorph::internals::Rng;

/// Frames of a stretch, at least and at most.
const STRETCH: [usize; 2] = [32, 256];
/// Of a hundred random frames, this many …
const NEUTRAL: usize = 4;
const CUTS: usize = 3;
const STILL: usize = 10;
/// Random weights, as people exaggerate and as trackers overshoot.
const WEIGHTS: [f32; 2] = [-0.5, 1.5];

/// Frames without end, the same for a seed.
pub struct Script<'a> {
    rng: Rng,
    clips: &'a [BoundClip],
    now: Vec<f32>,
    /// Frames left of this stretch.
    left: usize,
    /// Clip and next frame; `None` in a random stretch.
    place: Option<(usize, usize)>,
}

impl<'a> Script<'a> {
    /// For `targets` targets.
    pub fn new(targets: usize, clips: &'a [BoundClip], seed: u64) -> Self {
        // An empty random stretch: captured frames come first, where there are any.
        Self { rng: Rng::new(seed, 0x736f_616b), clips, now: vec![0.0; targets], left: 0, place: None }
    }

    /// The weights of the next frame, and whether it is a cut.
    pub fn next(&mut self) -> (&[f32], bool) {
        if self.left == 0 {
            self.left = STRETCH[0] + self.rng.below(STRETCH[1] - STRETCH[0]);
            self.place = match self.place {
                None if !self.clips.is_empty() => {
                    let clip = self.rng.below(self.clips.len());
                    Some((clip, self.rng.below(self.clips[clip].frame_count())))
                }
                _ => None,
            };
        }
        self.left -= 1;
        let cut = match &mut self.place {
            Some((clip, frame)) => {
                let clip = &self.clips[*clip];
                self.now = clip.frame(*frame);
                // Round and round: the seam is a jump, as between takes.
                *frame = (*frame + 1) % clip.frame_count();
                false
            }
            None => self.random(),
        };
        (&self.now, cut)
    }

    fn random(&mut self) -> bool {
        let targets = self.now.len();
        let dice = self.rng.below(100);
        if dice < NEUTRAL {
            self.now.fill(0.0);
        } else if dice < NEUTRAL + CUTS {
            (0..targets).for_each(|t| self.draw(t));
            return true;
        } else if dice >= NEUTRAL + CUTS + STILL && targets > 0 {
            // Often a few, seldom all: as many as the smaller of two numbers.
            let count = 1 + self.rng.below(targets).min(self.rng.below(targets));
            for _ in 0..count {
                let target = self.rng.below(targets);
                self.draw(target);
            }
        }
        false
    }

    /// A new weight; every third one comes to rest.
    fn draw(&mut self, target: usize) {
        let rest = self.rng.below(3) == 0;
        self.now[target] = if rest { 0.0 } else { self.rng.range(WEIGHTS[0], WEIGHTS[1]) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltamorph::WeightClip;

    #[test]
    fn there_is_some_of_everything() {
        let names: Vec<String> = (0..12).map(|t| t.to_string()).collect();
        let values = [[9.0f32; 12], [8.0; 12]].concat();
        let clip = WeightClip { names: names.clone(), values, ..Default::default() };
        let clips = [clip.bind(&names.iter().map(String::as_str).collect::<Vec<_>>()).expect("columns of targets")];
        let mut script = Script::new(12, &clips, 1);
        let (mut captured, mut neutral, mut still, mut cuts) = (0, 0, 0, 0);
        let mut before = vec![0.0; 12];
        for _ in 0..5000 {
            let (weights, cut) = script.next();
            captured += usize::from(weights[0] >= 8.0);
            neutral += usize::from(weights == [0.0; 12]);
            still += usize::from(weights == before);
            cuts += usize::from(cut);
            assert!(weights.iter().all(|w| *w >= 8.0 || (-0.5..1.5).contains(w)));
            before = weights.to_vec();
        }
        assert!((1500..3500).contains(&captured), "{captured}");
        assert!(neutral > 50 && still > 100 && cuts > 30, "{neutral} {still} {cuts}");
    }

    #[test]
    fn a_seed_is_a_script() {
        let run = |seed| {
            let mut script = Script::new(5, &[], seed);
            (0..300).map(|_| script.next().0.to_vec()).collect::<Vec<_>>()
        };
        assert_eq!(run(3), run(3));
        assert_ne!(run(3), run(4));
        assert!(Script::new(0, &[], 1).next().0.is_empty());
    }
}
