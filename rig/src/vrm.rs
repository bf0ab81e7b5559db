//! Rigs from the expressions of VRM files.

use super::{Control, Part, Rig};
use deltamorph::import::gltf::{Expression, Suppression};
use std::collections::HashSet;

/// Makes a rig of the expressions of a VRM file, for a mesh with the targets `targets`; `None` if none of them moves a
/// target.
///
/// Each expression that moves targets is a control from 0 to 1. Targets stay controls, unless an expression has their
/// name. An expression that overrides blinking, looking or the mouth blocks or attenuates the expressions of that kind.
///
/// ```no_run
/// # let targets = ["Fcl_ALL_Joy"];
/// let gltf = deltamorph::import::gltf::read("avatar.vrm".as_ref())?;
/// let rig = deltamorph_rig::vrm::rig(&gltf.expressions, &targets);
/// # Ok::<(), deltamorph::Error>(())
/// ```
pub fn rig(expressions: &[Expression], targets: &[&str]) -> Option<Rig> {
    let there: HashSet<&str> = targets.iter().copied().collect();
    let is_there = |target: &str| there.contains(target);
    let moves = |expression: &&Expression| expression.targets.iter().any(|(target, _)| is_there(target));
    let all: Vec<&Expression> = expressions.iter().filter(moves).collect();
    let control = |expression: &&Expression| {
        let parts = expression.targets.iter().filter(|(target, _)| is_there(target));
        let parts = parts.map(|(target, weight)| Part::new(target, *weight)).collect();
        let suppressed = |by: Suppression| {
            let overrides = expression.overrides.iter().filter(|(_, suppression)| *suppression == by);
            let of_kinds = overrides.flat_map(|(kind, _)| all.iter().filter(|other| other.kind == Some(*kind)));
            of_kinds.map(|other| other.name.clone()).collect()
        };
        let control = Control::new(&expression.name).limits([0.0, 1.0]).parts(parts).is_binary(expression.is_binary);
        control.blocks(suppressed(Suppression::Block)).attenuates(suppressed(Suppression::Blend))
    };
    let controls: Vec<Control> = all.iter().map(control).collect();
    (!controls.is_empty()).then(|| Rig { controls, keep_targets: true, ..Rig::default() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltamorph::import::gltf::Procedural;

    fn expression(name: &str, targets: &[(&str, f32)]) -> Expression {
        let mut made = Expression::default();
        made.name = name.into();
        made.targets = targets.iter().map(|(name, weight)| ((*name).to_owned(), *weight)).collect();
        made
    }

    #[test]
    fn expressions_are_controls_that_add_up_and_override() {
        let mut happy = expression("happy", &[("smile", 1.0), ("lids", 0.5), ("hat", 1.0)]);
        happy.overrides = vec![(Procedural::Blink, Suppression::Blend), (Procedural::Mouth, Suppression::Block)];
        let (mut blink, mut mouth) = (expression("blink", &[("lids", 1.0)]), expression("aa", &[("aa", 0.5)]));
        (blink.kind, mouth.kind) = (Some(Procedural::Blink), Some(Procedural::Mouth));
        let targets = ["smile", "lids", "aa", "other"];
        let all = [happy.clone(), blink.clone(), mouth, expression("glow", &[]), expression("hat", &[("hat", 1.0)])];
        let bound = rig(&all, &targets).unwrap().bind(&targets).unwrap();
        let controls: Vec<&str> = bound.controls().collect();
        assert_eq!(controls, ["happy", "blink", "aa", "smile", "lids", "other"]);
        let of = |weights: [f32; 6]| {
            let mut out = [0.0; 4];
            bound.evaluate(&weights, &mut out).unwrap();
            out
        };
        assert_eq!(of([0.0, 1.0, 1.0, 0.0, 0.25, 0.0]), [0.0, 1.25, 0.5, 0.0]);
        assert_eq!(of([0.5, 1.0, 1.0, 0.0, 0.0, 2.0]), [0.5, 0.25 + 0.5, 0.0, 2.0]);
        assert_eq!(of([2.0, 1.0, 1.0, 0.5, 0.0, 0.0]), [1.5, 0.5, 0.0, 0.0]);
        assert_eq!(rig(&all[3..], &targets), None);
        // What is binary overrides, and is overridden, as a whole.
        (happy.is_binary, blink.is_binary) = (true, true);
        for (all, at, wanted) in [
            ([happy.clone(), all[1].clone()], [0.4, 0.75], 0.75),
            ([happy, all[1].clone()], [0.6, 0.75], 0.5),
            ([all[0].clone(), blink.clone()], [0.25, 0.75], 0.125),
            ([all[0].clone(), blink], [0.0, 0.75], 1.0),
        ] {
            let bound = rig(&all, &["lids"]).unwrap().bind(&["lids"]).unwrap();
            let mut out = [0.0];
            bound.evaluate(&[at[0], at[1], 0.0], &mut out).unwrap();
            assert_eq!(out, [wanted], "{at:?}");
        }
    }
}
