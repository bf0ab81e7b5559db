//! Delta weights: what is asked for minus what a pose buffer already holds.

use crate::error::{Error, Result};

/// A target and the factor by which a pass adds its delta: a weight (full evaluation) or a delta weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coefficient {
    /// Index of the target.
    pub target: u32,
    /// Weight or delta weight.
    pub value: f32,
}

/// Append the changed targets (`weight ≠ applied weight`) with their delta weights, ascending by target.
pub fn changed_targets(weights: &[f32], applied: &[f32], out: &mut Vec<Coefficient>) {
    out.extend(
        weights
            .iter()
            .zip(applied)
            .enumerate()
            .filter(|(_, (w, a))| w != a)
            .map(|(target, (w, a))| Coefficient { target: target as u32, value: w - a }),
    );
}

/// Append the active targets (`weight ≠ 0`) with their weights, ascending by target.
pub fn active_targets(weights: &[f32], out: &mut Vec<Coefficient>) {
    out.extend(
        weights
            .iter()
            .enumerate()
            .filter(|(_, w)| **w != 0.0)
            .map(|(target, &value)| Coefficient { target: target as u32, value }),
    );
}

/// The largest weight, either sign. Beyond it a float32 pose has no digits left for the base.
pub const WEIGHT_MAX: f32 = 1e6;

/// Check weights handed in by a caller: one per target, finite, and not beyond [`WEIGHT_MAX`].
///
/// # Errors
/// Too few or too many weights, or one that is out of range; the message names it.
pub fn check_weights<'a>(weights: &[f32], name: impl Fn(usize) -> Option<&'a str>, target_count: usize) -> Result<()> {
    if weights.len() != target_count {
        return Err(Error::invalid(
            format!("{} weights given, but the mesh has {target_count} targets", weights.len()),
            "pass one weight for each target, in the order of the mesh",
        ));
    }
    match weights.iter().position(|w| !(-WEIGHT_MAX..=WEIGHT_MAX).contains(w)) {
        None => Ok(()),
        Some(i) => Err(Error::invalid(
            format!("the weight of target {i} ('{}') is {}", name(i).unwrap_or("?"), weights[i]),
            format!("weights may be negative or above one, but must be numbers from -{WEIGHT_MAX} to {WEIGHT_MAX}"),
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_changed_is_listed() {
        let mut out = vec![];
        changed_targets(&[0.5, -0.25, 0.0, 1.0], &[0.5, 0.25, -0.0, 0.0], &mut out);
        assert_eq!(out, [Coefficient { target: 1, value: -0.5 }, Coefficient { target: 3, value: 1.0 }]);
    }

    #[test]
    fn negative_weights_are_active() {
        let mut out = vec![];
        active_targets(&[0.0, -0.1, 1.5], &mut out);
        assert_eq!(out.iter().map(|c| c.target).collect::<Vec<_>>(), [1, 2]);
    }

    #[test]
    fn bad_weights_are_named() {
        let name = |i| ["jawOpen", "smile"].get(i).copied();
        let text = check_weights(&[0.0, f32::NAN], name, 2).unwrap_err().to_string();
        assert!(text.contains("target 1 ('smile') is NaN"), "{text}");
        let text = check_weights(&[0.0, -3e38], name, 2).unwrap_err().to_string();
        assert!(text.contains("from -1000000 to 1000000"), "{text}");
        let text = check_weights(&[0.0], name, 2).unwrap_err().to_string();
        assert!(text.contains("1 weights given, but the mesh has 2 targets"), "{text}");
    }
}
