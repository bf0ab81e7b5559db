//! Helpers for tests of techniques; schedules of several crowds; rejected descriptions.

use super::hazards::{Accesses, Event as Recorded, HazardChecker, Memory, trace};
use super::schedule::{Barrier, Schedule, asset_uploaded};
use super::steps::{Resource, Stage, Steps, Use, Work};
use super::*;
use proptest::prelude::*;

/// A frame: weights from a small grid (so that some stay as they are), and what happens around it.
#[derive(Clone, Debug)]
pub(crate) enum Event {
    /// `None`: the same weights again.
    Update(Option<Vec<f32>>),
    DiscardLast(u64),
    Cut,
}

pub(crate) fn events(targets: usize) -> impl Strategy<Value = Vec<Event>> {
    let weights = proptest::collection::vec((-2i8..5).prop_map(|w| f32::from(w) * 0.25), targets);
    let event = prop_oneof![
        8 => proptest::option::weighted(0.75, weights).prop_map(Event::Update),
        1 => (0u64..4).prop_map(Event::DiscardLast),
        1 => Just(Event::Cut),
    ];
    proptest::collection::vec(event, 1..30)
}

/// The recorded events of an update of one or several crowds.
pub(crate) fn scheduled(updates: &[&Steps], accesses: impl FnMut(u32, &[Work]) -> Vec<Accesses>) -> Vec<Recorded> {
    let mut schedule = Schedule::default();
    schedule.fill(updates.iter().copied());
    trace(&schedule.entries, accesses)
}

/// A checker after the upload of the mesh and the creation of a crowd animated on the GPU.
pub(crate) fn checker() -> HazardChecker {
    let mut checker = HazardChecker::default();
    checker.upload(asset_uploaded());
    let written = [Memory::Clips, Memory::Records, Memory::Weights, Memory::History, Memory::Counters];
    let [copied, used] = crate::update::animated::UPLOADED;
    checker.copy(0, &written, Barrier::between(copied, used));
    checker
}

/// An update, and the slots drawn after it.
pub(crate) type DrawnUpdate = (Vec<Recorded>, [Option<u32>; 2]);

/// Asserts that the fourth of `frames` has `count` barriers and that each is needed. The slots of a frame are drawn in
/// each of up to four crowds.
pub(crate) fn assert_barriers_needed(frames: &[DrawnUpdate], count: usize, what: &str) {
    let barriers = frames[3].0.iter().enumerate().filter(|(_, event)| matches!(event, Recorded::Barrier(_)));
    let barriers: Vec<usize> = barriers.map(|(i, _)| i).collect();
    assert_eq!(barriers.len(), count, "{what}");
    for dropped in barriers.into_iter().map(Some).chain([None]) {
        let mut checker = checker();
        for (f, (events, drawn)) in frames.iter().enumerate() {
            let mut events = events.clone();
            if let (3, Some(at)) = (f, dropped) {
                events.remove(at);
            }
            checker.update(&events);
            let drawn = drawn.iter().flatten().flat_map(|slot| (0..4).map(move |crowd| (crowd, *slot)));
            drawn.for_each(|(crowd, slot)| checker.draw(crowd, 0, slot));
        }
        let found = checker.finish();
        assert_eq!(found.is_err(), dropped.is_some(), "{what}, dropped {dropped:?}: {found:?}");
    }
}

const PASS: &[Use] = &[Use::read(Resource::Poses), Use::write(Resource::Poses)];

/// Crowds updated together share barriers, and each barrier is needed.
#[test]
fn several_crowds_have_common_rounds_and_barriers() {
    let update = |length: u32| {
        let mut steps = Steps::new(Consumers::default());
        for kernel in 0..length {
            steps.step(PASS);
            steps.push(Work { kernel, ..Work::default() });
        }
        steps
    };
    let updates = [1, 3, 0, 1].map(update);
    let pose = Memory::Pose { instance: 0, slot: 0 };
    let events = scheduled(&updates.iter().collect::<Vec<_>>(), |_, _| vec![Accesses::compute([pose], [pose])]);
    let crowd = |event: &Recorded| match event {
        Recorded::Barrier(_) => None,
        Recorded::Step { crowd, .. } => Some(*crowd),
    };
    let shape: Vec<Option<u32>> = events.iter().map(crowd).collect();
    assert_eq!(shape, [None, Some(0), Some(1), Some(3), None, Some(1), None, Some(1), None]);
    assert_barriers_needed(&vec![(events, [Some(0), None]); 5], 4, "four crowds");
}

/// Barriers name the stages of the host's consumers, and no others.
#[test]
fn barriers_name_the_consumers() {
    for (consumers, stages) in [
        (Consumers::VERTEX_SHADERS | Consumers::COPIES, Stage::VertexShader as u32 | Stage::Transfer as u32),
        (Consumers::MESH_SHADERS, Stage::TaskShader as u32 | Stage::MeshShader as u32),
        ((Consumers::default() | Consumers::COPIES).of_queue(false), Stage::Transfer as u32),
        ((Consumers::MESH_SHADERS | Consumers::RAY_TRACING_SHADERS).of_queue(false), Stage::RayTracingShader as u32),
        (Consumers::default().of_queue(true), Stage::VertexShader as u32 | Stage::VertexInput as u32),
    ] {
        let mut steps = Steps::new(consumers);
        steps.step(PASS);
        steps.push(Work::default());
        let events = scheduled(&[&steps], |_, _| vec![]);
        let [Recorded::Barrier(before), _, Recorded::Barrier(after)] = &events[..] else { panic!("{events:?}") };
        assert_eq!(before.before.stages, stages | Stage::Compute as u32);
        assert_eq!((after.before.stages, after.after.stages), (Stage::Compute as u32, stages));
    }
    // All consumers are on other queues: a semaphore makes poses visible, and the update waits only for earlier ones.
    assert_eq!((Consumers::default() | Consumers::FRAGMENT_SHADERS).of_queue(false), Consumers::NONE);
    let mut steps = Steps::new(Consumers::NONE);
    steps.step(PASS);
    steps.push(Work::default());
    let events = scheduled(&[&steps], |_, _| vec![]);
    let [Recorded::Barrier(before), Recorded::Step { .. }] = &events[..] else { panic!("{events:?}") };
    assert_eq!((before.before.stages, before.after.stages), (Stage::Compute as u32, Stage::Compute as u32));
}

/// Works of one step run concurrently: none may use what another writes.
#[test]
fn works_of_a_step_must_not_share_what_they_write() {
    let pose = |instance| Memory::Pose { instance, slot: 0 };
    let work = |instance| Accesses::compute([Memory::Deltas], [pose(instance)]);
    for (other, wrong) in [(work(1), false), (work(0), true), (Accesses::compute([pose(0)], [pose(1)]), true)] {
        let mut checker = HazardChecker::default();
        checker.update(&[Recorded::Step { crowd: 0, works: vec![work(0), other] }]);
        assert_eq!(checker.finish().is_err(), wrong);
    }
}

#[test]
fn bad_descriptions_are_refused() {
    for (desc, words) in [
        (UpdateDesc { slots: 0, ..UpdateDesc::new(UpdatePath::Compute, BatchSize::All) }, "1 to 64 slots"),
        (UpdateDesc::new(UpdatePath::Compute, BatchSize::Targets(0)), "batch size of 0"),
        (UpdateDesc { tolerance: 0.0, ..UpdateDesc::blocks() }, "a tolerance of 0"),
        (UpdateDesc { error_budget: -1.0, ..UpdateDesc::blocks() }, "an error budget of -1"),
        (UpdateDesc { error_budget: 1.0, ..UpdateDesc::new(UpdatePath::Compute, BatchSize::All) }, "with 'compute'"),
    ] {
        crate::testing::says(desc.check(), &[words]);
    }
}
