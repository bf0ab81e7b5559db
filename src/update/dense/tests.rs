//! Plans of dense passes reach the requested weights, and their recordings have no hazard.

use super::compute::ComputePasses;
use super::feedback::FeedbackPasses;
use super::technique::Passes;
use super::*;
use crate::plan::hazards::{Event as Recorded, dense};
use crate::plan::instances::Instances;
use crate::plan::steps::{Source, Steps, Use};
use crate::plan::tests::{events, scheduled};
use crate::plan::{BatchSize, Consumers, UpdateDesc, UpdateMode, UpdatePath};
use crate::update::tests::{One, Planned, every_barrier_is_needed, follow};
use proptest::prelude::*;

/// Memory uses of a path's passes.
fn uses(path: UpdatePath) -> &'static [Use] {
    match path {
        UpdatePath::Feedback => FeedbackPasses::USES,
        _ => ComputePasses::USES,
    }
}

/// The dense paths.
const PATHS: &[UpdatePath] = &[UpdatePath::Feedback, UpdatePath::Compute];

/// The recorded events of an update.
fn recorded(planner: &DensePlanner, path: UpdatePath) -> Vec<Recorded> {
    let mut steps = Steps::new(Consumers::default());
    planner.fill(1, uses(path), &mut steps);
    scheduled(&[&steps], |_, works| works.iter().map(|work| dense(path, work)).collect())
}

/// Contents of a slot, from the passes alone: base plus these weights.
type Held = Option<Vec<f64>>;

fn one(desc: UpdateDesc, targets: usize) -> Option<One<DensePlanner>> {
    let planner = DensePlanner::new(desc, 1).ok()?;
    Some(One::new(desc, targets, planner, vec![None; desc.slots as usize]))
}

impl Planned for DensePlanner {
    type Memory = Vec<Held>;
    type Pose = Held;

    fn update(one: &mut One<Self>) -> Vec<Recorded> {
        one.planner.plan(&mut one.instances, one.update);
        let (plan, weights) = (&one.planner.plans()[0], one.instances.requested().next().flatten().unwrap());
        follow_passes(plan, &mut one.memory, weights.len());
        let (result, _) = one.instances.slots_of(0).unwrap();
        assert_eq!(one.memory[result as usize], Some(weights.iter().map(|&w| f64::from(w)).collect()));
        assert_eq!(plan.applied, weights);
        assert!(plan.passes.is_empty() || plan.passes.len() == one.desc.batch.passes(plan.coefficients.len()));
        recorded(&one.planner, one.desc.path)
    }

    fn pose(one: &One<Self>, slot: u32) -> Held {
        one.memory[slot as usize].clone()
    }
}

/// Applies `plan` to `slots`.
fn follow_passes(plan: &Plan, slots: &mut [Held], targets: usize) {
    for pass in &plan.passes {
        let mut pose = match pass.source {
            Source::Base => Some(vec![0.0; targets]),
            Source::Slot(s) => slots[s as usize].clone(),
        };
        if let Some(weights) = &mut pose {
            for c in plan.coefficients_of(pass) {
                weights[c.target as usize] += f64::from(c.value);
            }
        }
        slots[pass.destination as usize] = pose;
    }
}

fn descs() -> impl Strategy<Value = UpdateDesc> {
    let batch = prop_oneof![(1u32..20).prop_map(BatchSize::Targets), Just(BatchSize::All)];
    let mode = prop_oneof![Just(UpdateMode::Incremental), Just(UpdateMode::Rebuild)];
    let path = prop::sample::select(PATHS);
    (path, batch, mode, 1u32..5)
        .prop_map(|(path, batch, mode, slots)| UpdateDesc { mode, slots, ..UpdateDesc::new(path, batch) })
        .prop_filter("valid", |d| d.check().is_ok())
}

proptest! {
    #[test]
    fn plans_reach_the_weights_without_hazards(desc in descs(), events in events(9)) {
        follow(one(desc, 9).unwrap(), events);
    }
}

#[test]
fn every_barrier_of_passes_is_needed() {
    for &path in PATHS {
        for (batch, slots) in [(1, 2), (2, 2), (4, 2), (9, 2), (1, 1), (9, 1)] {
            let desc = UpdateDesc { slots, ..UpdateDesc::new(path, BatchSize::Targets(batch)) };
            let Some(one) = one(desc, 9) else { continue };
            every_barrier_is_needed(one, 9, 6usize.div_ceil(batch as usize) + 1, &format!("{desc:?}"));
        }
    }
}

#[test]
fn rounds_of_a_crowd_share_their_barriers() {
    let desc = UpdateDesc::new(UpdatePath::Compute, BatchSize::Targets(2));
    let (mut planner, mut instances) = (DensePlanner::new(desc, 3).unwrap(), Instances::new(3, 3, desc.slots, 1));
    for (instance, weights) in (0..).zip([[1.0, 1.0, 1.0], [1.0, 0.0, 0.0], [0.0; 3]]) {
        instances.set_weights(instance, &weights).unwrap();
    }
    planner.plan(&mut instances, 1);
    let works = |event: &Recorded| if let Recorded::Step { works, .. } = event { works.len() } else { 0 };
    let shape: Vec<usize> = recorded(&planner, UpdatePath::Compute).iter().map(works).collect();
    assert_eq!(shape, [0, 3, 0, 1, 0]);
}
