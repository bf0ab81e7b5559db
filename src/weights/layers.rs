//! Layers of clips: several clips at their own times and weights, mixed to one weight vector.

use super::BoundClip;
use crate::error::{Error, Result};
use crate::setters::setters;

/// Behaviour of a clip outside its frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Repeat {
    /// Loops; the last frame is followed by the first.
    #[default]
    Loop,
    /// Holds the first frame before the clip and the last one after it.
    Once,
}

/// How a layer blends with those below it; see [`ClipLayer`] for the formulas.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum LayerBlend {
    /// Towards the clip's weights.
    #[default]
    Override,
    /// Adds the clip's weights.
    Additive,
}

/// A clip at a time, in a stack of layers for [`mix`](Self::mix).
///
/// For layer weight w, mask m of a target and clip weight s of the target at the layer's time, the result v of the
/// target is updated layer by layer, the first one lowest:
///
/// ```text
/// override   v · (1 − w · m) + w · m · s      towards the clip: 1 replaces the layers below, 0 keeps them
/// additive   v + w · m · s                    on top of the layers below
/// ```
///
/// Targets without a column in the clip are unchanged.
///
/// Example uses: a cross-fade is a layer of weight 1 and above it one whose weight goes from 0 to 1; speech over an
/// expression is an override with a mask of the mouth.
///
/// ```
/// use deltamorph::{ClipLayer, LayerBlend, WeightClip};
///
/// let names = vec!["jaw".to_owned()];
/// let talk = WeightClip { name: "talk".into(), names, fps: 2.0, values: vec![0.0, 0.5] }.bind(&["jaw", "blink"])?;
/// let names = vec!["blink".to_owned()];
/// let blink = WeightClip { name: "blink".into(), names, fps: 30.0, values: vec![1.0] }.bind(&["jaw", "blink"])?;
/// let layers = [ClipLayer::new(&talk, 0.25), ClipLayer::new(&blink, 0.0).blend(LayerBlend::Additive).weight(0.5)];
/// let mut weights = [0.0; 2];
/// ClipLayer::mix(&layers, &mut weights)?;
/// assert_eq!(weights, [0.25, 0.5]);
/// # Ok::<(), deltamorph::Error>(())
/// ```
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct ClipLayer<'a> {
    /// The clip.
    pub clip: &'a BoundClip,
    /// Seconds since the clip's first frame. Weights between frames are interpolated linearly.
    pub time: f64,
    /// Behaviour before the first frame and after the last one.
    pub repeat: Repeat,
    /// Weight of the layer, from 0 to 1 to fade it in.
    pub weight: f32,
    /// How it blends with the layers below.
    pub blend: LayerBlend,
    /// Factor of each target, in the mesh's order; `None`: 1 for all.
    pub mask: Option<&'a [f32]>,
}

setters!(ClipLayer<'a> { repeat: Repeat, weight: f32, blend: LayerBlend, mask: Option<&'a [f32]> });

impl<'a> ClipLayer<'a> {
    /// A looping clip, `time` seconds after its first frame, that replaces the layers below.
    pub fn new(clip: &'a BoundClip, time: f64) -> Self {
        Self { clip, time, repeat: Repeat::Loop, weight: 1.0, blend: LayerBlend::Override, mask: None }
    }

    /// Mixes `layers`, the first one lowest, on top of `weights`, which hold zeros or the host's weights. The result is
    /// an argument for [`Crowd::set_weights`](crate::Crowd::set_weights) or, if clips are bound to the
    /// [names](crate::WeightMap::names) of a map, for [`WeightMap::apply`](crate::WeightMap::apply).
    ///
    /// Does not allocate.
    ///
    /// # Errors
    /// A clip or mask for another number of targets than `weights`; a time, weight or mask factor that is not finite; a
    /// clip without a frame rate. `weights` are unchanged then.
    pub fn mix(layers: &[ClipLayer<'a>], weights: &mut [f32]) -> Result<()> {
        layers.iter().enumerate().try_for_each(|(number, layer)| layer.check(number, weights.len()))?;
        for Self { clip, time, repeat, weight, blend, mask } in layers {
            let Some((frames, fraction)) = clip.frames_at(*time, *repeat) else { continue };
            let [before, after] = frames.map(|frame| clip.row(frame));
            for ((&target, before), after) in clip.columns.iter().zip(before).zip(after) {
                let says = before + (after - before) * fraction;
                let amount = weight * mask.map_or(1.0, |mask| mask[target]);
                let below = &mut weights[target];
                *below = match blend {
                    LayerBlend::Override => *below * (1.0 - amount) + amount * says,
                    LayerBlend::Additive => *below + amount * says,
                };
            }
        }
        Ok(())
    }

    fn check(&self, number: usize, targets: usize) -> Result<()> {
        let Self { clip, time, weight, mask, .. } = self;
        let refuse = |what: String, remedy: &str| {
            Err(Error::invalid(format!("layer {number}, of clip '{}': {what}", clip.name), remedy))
        };
        if clip.target_count() != targets {
            let what = format!("its clip is bound to {} targets, and {targets} weights are mixed", clip.target_count());
            return refuse(what, "bind all clips to the targets, or to the names of the set, that the weights are of");
        }
        if let Some(mask) = mask.filter(|mask| mask.len() != targets) {
            let what = format!("a mask of {} factors for {targets} targets", mask.len());
            return refuse(what, "state a factor for each target");
        }
        if !(clip.fps.is_finite() && clip.fps > 0.0) {
            return refuse(format!("{} frames a second", clip.fps), "give the clip a frame rate above 0");
        }
        if !time.is_finite() || !weight.is_finite() {
            return refuse(format!("time {time} and weight {weight}"), "use finite numbers");
        }
        match mask.and_then(|mask| mask.iter().position(|factor| !factor.is_finite())) {
            Some(target) => refuse(format!("the mask of target {target} is no number"), "use finite numbers"),
            None => Ok(()),
        }
    }
}

impl BoundClip {
    /// The frames before and after `seconds`, and the fraction between them; `None` for a clip without frames.
    fn frames_at(&self, seconds: f64, repeat: Repeat) -> Option<([usize; 2], f32)> {
        let last = self.frame_count().checked_sub(1)?;
        let at = seconds * f64::from(self.fps);
        let (at, after) = match repeat {
            // rem_euclid may round up to the length.
            Repeat::Loop => (at.rem_euclid((last + 1) as f64) % (last + 1) as f64, 0),
            Repeat::Once => (at.clamp(0.0, last as f64), last),
        };
        let frame = at as usize;
        Some(([frame, if frame == last { after } else { frame + 1 }], at.fract() as f32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::weights::WeightClip;

    const TARGETS: [&str; 3] = ["jaw", "brow", "smile"];

    fn clip(names: &[&str], values: &[f32]) -> BoundClip {
        let names = names.iter().map(|&n| n.to_owned()).collect();
        WeightClip { name: "clip".into(), names, fps: 10.0, values: values.to_vec() }.bind(&TARGETS).unwrap()
    }

    fn mixed(layers: &[ClipLayer<'_>], weights: [f32; 3]) -> [f32; 3] {
        let mut weights = weights;
        ClipLayer::mix(layers, &mut weights).unwrap();
        weights
    }

    #[test]
    fn times_are_between_frames_and_wrap_or_stay() {
        let clip = clip(&["jaw"], &[0.0, 1.0, 3.0]);
        for (time, looped, once) in [
            (0.0, 0.0, 0.0),
            (0.05, 0.5, 0.5),
            (0.1, 1.0, 1.0),
            (0.15, 2.0, 2.0),
            (0.25, 1.5, 3.0),
            (0.3, 0.0, 3.0),
            (-0.05, 1.5, 0.0),
            (-1e-20, 0.0, 0.0),
            (3.05, 0.5, 3.0),
        ] {
            for (repeat, expected) in [(Repeat::Loop, looped), (Repeat::Once, once)] {
                let [jaw, ..] = mixed(&[ClipLayer::new(&clip, time).repeat(repeat)], [9.0; 3]);
                assert!((jaw - expected).abs() < 1e-5, "{repeat:?} at {time}: {jaw}, not {expected}");
            }
        }
        assert_eq!(mixed(&[ClipLayer::new(&super::tests::clip(&["jaw"], &[]), 0.0)], [9.0; 3]), [9.0; 3], "no frames");
    }

    #[test]
    fn layers_replace_fade_add_and_leave_alone_what_is_not_theirs() {
        let (a, b) = (clip(&["jaw", "brow"], &[0.1, 0.7]), clip(&["brow", "smile"], &[0.3, 0.9]));
        let [below, above] = [ClipLayer::new(&a, 0.0), ClipLayer::new(&b, 0.0)];
        // Bit for bit: an override of weight 1 leaves nothing of the layers below.
        assert_eq!(mixed(&[below, above], [1e6, 1e6, 0.5]), [0.1, 0.3, 0.9]);
        assert_eq!(mixed(&[below, above.weight(0.0)], [0.0, 0.0, 0.5]), [0.1, 0.7, 0.5]);
        let fade = mixed(&[below, above.weight(0.25)], [0.0, 0.0, 0.5]);
        assert_eq!(fade, [0.1, 0.7 * 0.75 + 0.25 * 0.3, 0.5 * 0.75 + 0.25 * 0.9]);
        assert_eq!(mixed(&[above, below], [0.0; 3]), [0.1, 0.7, 0.9], "the order counts");
        let added = mixed(&[below, above.blend(LayerBlend::Additive).weight(0.5)], [0.0, 0.0, 0.5]);
        assert_eq!(added, [0.1, 0.7 + 0.5 * 0.3, 0.5 + 0.5 * 0.9]);
        let mask = [0.5, 1.0, 0.0];
        assert_eq!(mixed(&[below.mask(Some(&mask)), above.mask(Some(&mask))], [0.0, 0.0, 0.5]), [0.05, 0.3, 0.5]);
    }

    #[test]
    fn what_cannot_be_mixed_is_refused_and_changes_nothing() {
        let (clip, mut other) = (clip(&["jaw"], &[0.5]), clip(&["jaw"], &[0.5]));
        other.fps = 0.0;
        let layer = ClipLayer::new(&clip, 0.0);
        for (bad, words) in [
            (ClipLayer::new(&clip, f64::NAN), "layer 1, of clip 'clip': time NaN"),
            (layer.weight(f32::INFINITY), "weight inf; use finite"),
            (layer.mask(Some(&[1.0; 2])), "a mask of 2 factors for 3 targets"),
            (layer.mask(Some(&[1.0, f32::NAN, 1.0])), "the mask of target 1 is no number"),
            (ClipLayer::new(&other, 0.0), "0 frames a second"),
        ] {
            let mut weights = [0.25; 3];
            crate::testing::says(ClipLayer::mix(&[layer, bad], &mut weights), &[words]);
            assert_eq!(weights, [0.25; 3]);
        }
        let text = ClipLayer::mix(&[layer], &mut [0.0; 2]).unwrap_err().to_string();
        assert!(text.contains("bound to 3 targets, and 2 weights are mixed; bind all clips"), "{text}");
    }
}
