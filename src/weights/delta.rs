//! Delta weights: requested weights minus applied weights.

/// A target and the factor of its delta in a pass: a weight (full evaluation) or a delta weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coefficient {
    /// Index of the target.
    pub target: u32,
    /// Weight or delta weight.
    pub value: f32,
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
    out.extend(changed.map(|(target, (w, a))| Coefficient { target: target as u32, value: w - a }));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_changed_or_is_active_is_listed() {
        let listed = |out: Vec<Coefficient>| out.iter().map(|c| (c.target, c.value)).collect::<Vec<_>>();
        let (mut changed, mut active) = (vec![], vec![]);
        changed_targets(&[0.5, -0.25, 0.0, 1.0], &[0.5, 0.25, -0.0, 0.0], &mut changed);
        assert_eq!(listed(changed), [(1, -0.5), (3, 1.0)]);
        active_targets(&[0.0, -0.1, 1.5, -0.0], &mut active);
        assert_eq!(listed(active), [(1, -0.1), (2, 1.5)]);
    }
}
