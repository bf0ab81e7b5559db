//! Plans of dense passes reach the weights requested, and what they record has no hazard.

use super::feedback::{FEEDBACK_PASS, feedback_accesses};
use super::plan::compute_accesses;
use super::*;
use crate::pack::{DeltaFormat, PackDesc, PackedMesh};
use crate::plan::hazards::{Accesses, Event as Recorded, HazardChecker};
use crate::plan::instances::Instances;
use crate::plan::schedule::asset_uploaded;
use crate::plan::steps::{Source, Steps, Use, Work};
use crate::plan::tests::{Event, assert_barriers_needed, events, scheduled};
use crate::plan::{BatchSize, Consumers, UpdateDesc, UpdateMode, UpdatePath};
use crate::weights::delta::Coefficient;
use proptest::prelude::*;

type AccessesOf = fn(&[Work]) -> Vec<Accesses>;

/// What passes of a path use, coarsely and in detail.
fn passes(path: UpdatePath) -> (&'static [Use], AccessesOf) {
    match path {
        UpdatePath::Feedback => (FEEDBACK_PASS, feedback_accesses),
        #[cfg(feature = "baselines")]
        UpdatePath::VertexStore => (crate::baselines::STORE_PASS, crate::baselines::store_accesses),
        _ => (COMPUTE_PASS, compute_accesses),
    }
}

/// The paths there are.
const PATHS: &[UpdatePath] = &[
    UpdatePath::Feedback,
    UpdatePath::Compute,
    #[cfg(feature = "baselines")]
    UpdatePath::VertexStore,
];

/// What an update records.
fn recorded(planner: &mut DensePlanner, path: UpdatePath) -> Vec<Recorded> {
    let (uses, accesses) = passes(path);
    let mut steps = Steps::new(Consumers::default());
    planner.fill(1, uses, &mut steps);
    scheduled(&[&steps], |_, works| accesses(works))
}

/// A crowd of one instance.
struct One {
    planner: DensePlanner,
    instances: Instances,
    update: u64,
}

impl One {
    fn new(desc: UpdateDesc, targets: usize) -> Option<Self> {
        let planner = DensePlanner::new(desc, 1).ok()?;
        Some(Self { planner, instances: Instances::new(1, targets, desc.slots), update: 0 })
    }

    /// The plan, and the slots of pose and previous pose.
    fn plan(&mut self, weights: &[f32]) -> (Plan, (u32, Option<u32>)) {
        self.instances.set_weights(0, weights).unwrap();
        self.update += 1;
        self.planner.plan(&mut self.instances, self.update);
        (self.planner.plans()[0].clone(), self.instances.slots_of(0).unwrap())
    }
}

/// An update that ran: its number, what it recorded, the slots drawn after it, and what slots held before.
type Ran = (u64, Vec<Recorded>, Vec<u32>, Vec<Held>);

/// What a slot holds, told by following the passes alone: base, plus these weights.
type Held = Option<Vec<f64>>;

/// Follow `plan` over `slots`.
fn follow(plan: &Plan, slots: &mut [Held], targets: usize) {
    for pass in &plan.passes {
        let mut pose = match pass.source {
            Source::Base => Some(vec![0.0; targets]),
            Source::Slot(s) => slots[s as usize].clone(),
        };
        if let Some(weights) = &mut pose {
            for c in &plan.coefficients[pass.coefficients.clone()] {
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
    /// Any sequence of updates, cuts and discarded updates: the result slot holds the weights asked for, the
    /// previous slot what was there before, and no access is unordered.
    #[test]
    fn plans_reach_the_weights_without_hazards(desc in descs(), events in events(9)) {
        const TARGETS: usize = 9;
        let mut one = One::new(desc, TARGETS).unwrap();
        let mut slots: Vec<Held> = vec![None; desc.slots as usize];
        // What the device did: the updates that ran, each with the slots drawn after it.
        let mut ran: Vec<Ran> = vec![];
        let mut cut = false;
        for event in events {
            match event {
                Event::DiscardLast(n) => {
                    // They never ran: the slots are what they were before the first of them.
                    let kept = ran.len().saturating_sub(n as usize);
                    for (number, _, _, before) in ran.drain(kept..).rev() {
                        one.instances.discard_from(number);
                        slots = before;
                    }
                }
                Event::Cut => { one.instances.cut(0).unwrap(); cut = true; }
                Event::Update(weights) => {
                    let wanted: Vec<f64> = weights.iter().map(|&w| f64::from(w)).collect();
                    let applied = one.planner.plans()[0].applied.iter().map(|&w| f64::from(w)).collect::<Vec<_>>();
                    let last = one.instances.slots_of(0).map(|_| applied);
                    let (plan, (result, previous)) = one.plan(&weights);
                    let list = recorded(&mut one.planner, desc.path);
                    let before = slots.clone();
                    follow(&plan, &mut slots, TARGETS);
                    let held = slots[result as usize].clone().expect("the result is known");
                    prop_assert_eq!(&held, &wanted);
                    prop_assert_eq!(&plan.applied, &weights);
                    let still = last.as_ref() == Some(&wanted);
                    let expected = match (last, cut) { (Some(l), false) => l, _ => wanted.clone() };
                    if let Some(previous) = previous {
                        prop_assert_eq!(slots[previous as usize].as_ref(), Some(&expected));
                    } else {
                        prop_assert!(desc.slots == 1 || (!desc.path.works_in_place() && desc.slots == 2));
                    }
                    if plan.passes.is_empty() {
                        prop_assert!(still && list.is_empty());
                    } else {
                        prop_assert_eq!(plan.passes.len(), desc.batch.passes(plan.coefficients.len()));
                    }
                    let drawn = previous.into_iter().chain([result]).collect();
                    ran.push((one.update, list, drawn, before));
                    cut = false;
                }
            }
        }
        let mut checker = HazardChecker::new();
        checker.upload(asset_uploaded());
        for (_, list, drawn, _) in &ran {
            checker.update(list);
            drawn.iter().for_each(|&slot| checker.draw(0, 0, slot));
        }
        prop_assert_eq!(checker.finish(), Ok(()));
    }
}

/// Take any one barrier of a running animation out, and the checker says so.
#[test]
fn every_barrier_is_needed() {
    for &path in PATHS {
        for (batch, slots) in [(1, 2), (2, 2), (4, 2), (9, 2), (1, 1), (9, 1)] {
            let desc = UpdateDesc { slots, ..UpdateDesc::new(path, BatchSize::Targets(batch)) };
            let Some(mut one) = One::new(desc, 9) else { continue };
            // Three frames to bring the slots round, then the one that is tampered with, then one more.
            let mut frames = vec![];
            for frame in 0..5 {
                let weight = |i: usize| if i % 3 == frame % 3 { 2.0 + frame as f32 } else { 1.0 };
                let (_, (result, previous)) = one.plan(&(0..9).map(weight).collect::<Vec<f32>>());
                frames.push((recorded(&mut one.planner, path), [Some(result), previous]));
            }
            assert_barriers_needed(&frames, 6usize.div_ceil(batch as usize) + 1, &format!("{desc:?}"));
        }
    }
}

#[test]
fn a_swapped_ping_pong_slot_is_seen() {
    for path in [UpdatePath::Feedback, UpdatePath::Compute] {
        let desc = UpdateDesc::new(path, BatchSize::Targets(1));
        let (mut one, mut slots) = (One::new(desc, 3).unwrap(), vec![None; 2]);
        follow(&one.plan(&[1.0, 1.0, 1.0]).0, &mut slots, 3);
        let (mut plan, (result, _)) = one.plan(&[1.0, 0.5, 1.0]);
        assert_eq!(plan.passes.len(), 1);
        let Source::Slot(source) = plan.passes[0].source else { panic!("{plan:?}") };
        let pass = &mut plan.passes[0];
        (pass.source, pass.destination) = (Source::Slot(pass.destination), source);
        follow(&plan, &mut slots, 3);
        assert_ne!(slots[result as usize], Some(vec![1.0, 0.5, 1.0]), "{path:?}");
    }
}

#[test]
fn a_vertex_pass_must_not_write_what_it_fetches() {
    for &path in PATHS.iter().filter(|path| !path.works_in_place()) {
        let pass = Work { source: Source::Slot(1), destination: 1, ..Work::default() };
        let mut checker = HazardChecker::new();
        checker.update(&[Recorded::Step { crowd: 0, works: passes(path).1(&[pass]) }]);
        let text = checker.finish().unwrap_err()[0].to_string();
        assert!(text.contains("write after read on Pose"), "{text}");
    }
}

#[test]
fn one_weight_among_57_active_is_one_pass_and_none_is_none() {
    for (path, batch) in [
        (UpdatePath::Feedback, BatchSize::Targets(1)),
        (UpdatePath::Feedback, BatchSize::Targets(7)),
        (UpdatePath::Compute, BatchSize::Targets(16)),
        (UpdatePath::Compute, BatchSize::All),
    ] {
        let mut one = One::new(UpdateDesc::new(path, batch), 57).unwrap();
        let mut weights = vec![0.5; 57];
        assert_eq!(one.plan(&weights).0.passes.len(), batch.passes(57));
        weights[33] = -0.25;
        let (plan, _) = one.plan(&weights);
        assert_eq!((plan.passes.len(), plan.coefficients.len(), plan.rebuilt), (1, 1, false));
        assert_eq!(plan.coefficients[0], Coefficient { target: 33, value: -0.75 });
        let (_, (result, previous)) = one.plan(&weights);
        assert!(recorded(&mut one.planner, path).is_empty() && previous == Some(result));
    }
}

#[test]
fn rounds_of_a_crowd_share_their_barriers() {
    let desc = UpdateDesc::new(UpdatePath::Compute, BatchSize::Targets(2));
    let (mut planner, mut instances) = (DensePlanner::new(desc, 3).unwrap(), Instances::new(3, 3, desc.slots));
    for (instance, weights) in (0..).zip([[1.0, 1.0, 1.0], [1.0, 0.0, 0.0], [0.0; 3]]) {
        instances.set_weights(instance, &weights).unwrap();
    }
    planner.plan(&mut instances, 1);
    let events = recorded(&mut planner, UpdatePath::Compute);
    let shape: Vec<usize> = events
        .iter()
        .map(|event| match event {
            Recorded::Barrier(_) => 0,
            Recorded::Step { works, .. } => works.len(),
        })
        .collect();
    assert_eq!(shape, [0, 3, 0, 1, 0]);
    let mesh = crate::testing::mesh(64, 3);
    let packed = PackedMesh::pack(&mesh, &PackDesc::new(DeltaFormat::Snorm16)).unwrap();
    let stats = planner.stats(std::iter::once(packed.layout()));
    assert_eq!((stats.bytes_moved, stats.bytes_floor), (64 * (4 * 48 + 4 * 12), 64 * (3 * 48 + 4 * 12)));
}
