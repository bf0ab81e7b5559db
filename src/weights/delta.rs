//! Delta weights: requested weights minus applied weights.

use crate::error::{Error, Result};

/// A target and the factor of its delta in a pass: a weight (full evaluation) or a delta weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coefficient {
    /// Index of the target.
    pub target: u32,
    /// Weight or delta weight.
    pub value: f32,
    /// The applied weight of the source pose, to which `value` is added; 0 in a full evaluation.
    pub held: f32,
}

/// Appends the changed targets (`weight ≠ applied weight`) with their delta weights, ascending by target.
pub fn changed_targets(weights: &[f32], applied: &[f32], out: &mut Vec<Coefficient>) {
    differences(weights, applied.iter().copied(), out);
}

/// Appends the active targets (`weight ≠ 0`) with their weights, ascending by target.
pub fn active_targets(weights: &[f32], out: &mut Vec<Coefficient>) {
    differences(weights, std::iter::repeat(0.0), out);
}

fn differences(weights: &[f32], applied: impl Iterator<Item = f32>, out: &mut Vec<Coefficient>) {
    let changed = weights.iter().zip(applied).enumerate().filter(|(_, (w, a))| *w != a);
    out.extend(changed.map(|(target, (w, a))| Coefficient { target: target as u32, value: w - a, held: a }));
}

/// Largest absolute weight. Beyond it a float32 pose has no digits left for the base.
pub const WEIGHT_MAX: f32 = 1e6;

/// Checks weights: one per target, finite, within ±[`WEIGHT_MAX`].
///
/// # Errors
/// A wrong number of weights, or one out of range; the message names it.
pub fn check_weights<'a>(weights: &[f32], name: impl Fn(usize) -> Option<&'a str>, target_count: usize) -> Result<()> {
    if weights.len() != target_count {
        return Err(Error::invalid(
            format!("{} weights given, but the mesh has {target_count} targets", weights.len()),
            "pass one weight for each target, in the order of the mesh",
        ));
    }
    weights.iter().enumerate().try_for_each(|(target, &weight)| check_weight(target, weight, &name))
}

/// Checks the weight of a target: finite, within ±[`WEIGHT_MAX`].
///
/// # Errors
/// A weight out of range; the message names the target.
pub fn check_weight<'a>(target: usize, weight: f32, name: impl Fn(usize) -> Option<&'a str>) -> Result<()> {
    if (-WEIGHT_MAX..=WEIGHT_MAX).contains(&weight) {
        return Ok(());
    }
    Err(Error::invalid(
        format!("the weight of target {target} ('{}') is {weight}", name(target).unwrap_or("?")),
        format!("weights may be negative or above one, but must be numbers from -{WEIGHT_MAX} to {WEIGHT_MAX}"),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_changed_or_is_active_is_listed() {
        let listed = |out: Vec<Coefficient>| out.iter().map(|c| (c.target, c.value, c.held)).collect::<Vec<_>>();
        let (mut changed, mut active) = (vec![], vec![]);
        changed_targets(&[0.5, -0.25, 0.0, 1.0], &[0.5, 0.25, -0.0, 0.0], &mut changed);
        assert_eq!(listed(changed), [(1, -0.5, 0.25), (3, 1.0, 0.0)]);
        active_targets(&[0.0, -0.1, 1.5, -0.0], &mut active);
        assert_eq!(listed(active), [(1, -0.1, 0.0), (2, 1.5, 0.0)]);
    }

    #[test]
    fn bad_weights_are_named() {
        let name = |i| ["jawOpen", "smile"].get(i).copied();
        for (weights, expected) in [
            (&[0.0, f32::NAN][..], "target 1 ('smile') is NaN"),
            (&[0.0, -3e38], "from -1000000 to 1000000"),
            (&[0.0], "1 weights given, but the mesh has 2 targets"),
        ] {
            crate::testing::says(check_weights(weights, name, 2), &[expected]);
        }
    }
}
