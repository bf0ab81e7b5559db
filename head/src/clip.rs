//! A weight clip like those captured from a performer.

use super::{HeadDesc, Rng, smoothstep, targets};
use deltamorph::WeightClip;

/// A capture-like weight clip for the built-in head, with a column for each of its targets.
///
/// Weights are in [0, 1] in steps of 1/255. There are blinks, bursts of speech on jaw and mouth, slow noise with pauses
/// on the rest, and columns that stay 0; about a third of the weights change from a frame to the next (at 30 frames per
/// second). An `fps` that is not a positive number counts as 30; one outside of 0.1 to 1000 is clamped.
pub fn head_clip(desc: &HeadDesc, frames: usize, fps: f32) -> WeightClip {
    let fps = if fps > 0.0 && fps.is_finite() { fps.clamp(0.1, 1000.0) } else { 30.0 };
    let names = targets::names(desc.targets);
    let count = names.len();
    let mut values = vec![0.0f32; count * frames];
    // Shared by all columns that they drive: both eyes blink together, jaw and lips speak together.
    let blink = blinks(&mut Rng::new(desc.seed, u64::MAX), frames, fps);
    let speech = syllables(&mut Rng::new(desc.seed, u64::MAX - 1), frames, fps);
    let speak = |rng: &mut Rng, height: f32| -> Vec<f32> {
        // Each articulator has its own share of every syllable.
        let share = drift(rng, frames, fps, 0.25, 0.0);
        speech.iter().zip(share).map(|(s, share)| height * s * (0.4 + 0.6 * share)).collect()
    };
    for (i, name) in names.iter().enumerate() {
        let rng = &mut Rng::new(desc.seed, (1 << 32) + i as u64);
        let column = match name.as_str() {
            "tongueOut" | "jawForward" | "jawLeft" | "jawRight" => continue,
            "jawOpen" => speak(rng, 0.75),
            "mouthFunnel" | "mouthPucker" | "mouthShrugLower" => speak(rng, 0.4),
            n if n.starts_with("mouthLowerDown") || n.starts_with("mouthUpperUp") => speak(rng, 0.5),
            "mouthClose" => speak(rng, 0.15),
            n if n.starts_with("eyeBlink") => blink.iter().map(|b| b * 0.95).collect(),
            n if n.starts_with("detail") && rng.unit() < 0.25 => continue,
            _ => {
                let height = rng.range(0.15, 0.7);
                drift(rng, frames, fps, 0.5, 0.55).iter().map(|d| height * d).collect()
            }
        };
        for (frame, w) in column.into_iter().enumerate() {
            // Steps of 1/255, as in capture files.
            values[frame * count + i] = (w.clamp(0.0, 1.0) * 255.0 + 0.5).floor() / 255.0;
        }
    }
    WeightClip { name: "head".to_owned(), names, fps, values, notes: vec![] }
}

/// Returns noise in [0, 1]: every `period` seconds or so a new value, or with probability `pause` the old one.
fn drift(rng: &mut Rng, frames: usize, fps: f32, period: f32, pause: f32) -> Vec<f32> {
    let mut column = Vec::with_capacity(frames);
    let (mut from, mut to) = (0.0, rng.unit() * rng.unit());
    let (mut start, mut length) = (0.0, (period * fps).max(1.0));
    for frame in 0..frames {
        while frame as f32 >= later(start, length) {
            start = later(start, length);
            length = (period * rng.range(0.6, 1.6) * fps).max(1.0);
            from = to;
            if rng.unit() >= pause {
                // A quarter of the time at rest, otherwise mostly low.
                to = if rng.unit() < 0.25 { 0.0 } else { rng.unit() * (0.4 + 0.6 * rng.unit()) };
            }
        }
        column.push(from + (to - from) * smoothstep(0.0, length, frame as f32 - start));
    }
    column
}

/// Returns a time about `length` after `time`, but always later: float32 rounds the length away at large times.
fn later(time: f32, length: f32) -> f32 {
    (time + length).max(time.next_up())
}

/// Returns blinks of a fifth of a second every 2 to 5 seconds.
fn blinks(rng: &mut Rng, frames: usize, fps: f32) -> Vec<f32> {
    let mut next = rng.range(0.5, 2.0);
    (0..frames)
        .map(|frame| {
            let t = frame as f32 / fps;
            while t > next + 0.25 {
                next = later(next, rng.range(2.0, 5.0));
            }
            smoothstep(next, next + 0.08, t) * smoothstep(next + 0.24, next + 0.12, t)
        })
        .collect()
}

/// Returns the opening of the mouth: syllables of an eighth to a third of a second, in bursts with pauses between.
fn syllables(rng: &mut Rng, frames: usize, fps: f32) -> Vec<f32> {
    let mut column = Vec::with_capacity(frames);
    let (mut start, mut length, mut height) = (0.0, rng.range(0.3, 1.0), 0.0);
    let mut left = 0;
    for frame in 0..frames {
        let t = frame as f32 / fps;
        while t >= later(start, length) {
            start = later(start, length);
            if left == 0 {
                left = 4 + rng.below(12);
                (length, height) = (rng.range(0.3, 1.6), 0.0);
            } else {
                left -= 1;
                (length, height) = (rng.range(0.12, 0.34), rng.range(0.25, 1.0));
            }
        }
        let middle = start + 0.45 * length;
        column.push(height * smoothstep(start, middle, t) * smoothstep(start + length, middle, t));
    }
    column
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clips_of_any_rate_end() {
        let desc = HeadDesc { targets: 3, ..Default::default() };
        let rates =
            [(1e-9, 0.1), (f32::MIN_POSITIVE, 0.1), (1e30, 1000.0), (24.0, 24.0), (0.0, 30.0), (f32::NAN, 30.0)];
        for (fps, taken) in rates {
            let clip = head_clip(&desc, 3, fps);
            assert_eq!((clip.fps, clip.frame_count()), (taken, 3));
        }
        // Float32 rounds the length away.
        assert!([1e8, 1e30].into_iter().all(|time: f32| time + 0.1 == time && later(time, 0.1) > time));
    }
}
