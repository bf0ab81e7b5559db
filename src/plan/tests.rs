use super::commands::{Command, CommandList, Hazard};
use super::hazards::HazardChecker;
use super::*;
use proptest::prelude::*;

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
    let path = prop_oneof![Just(UpdatePath::Feedback), Just(UpdatePath::Compute), Just(UpdatePath::VertexStore)];
    (path, batch, mode, 1u32..5)
        .prop_map(|(path, batch, mode, slots)| UpdateDesc { mode, slots, ..UpdateDesc::new(path, batch) })
        .prop_filter("valid", |d| d.check().is_ok())
}

/// A frame: weights from a small grid (so that some stay as they are), and what happens around it.
#[derive(Clone, Debug)]
pub(crate) enum Event {
    Update(Vec<f32>),
    DiscardLast(u64),
    Cut,
}

pub(crate) fn events(targets: usize) -> impl Strategy<Value = Vec<Event>> {
    let weights = proptest::collection::vec((-2i8..5).prop_map(|w| f32::from(w) * 0.25), targets);
    let event = prop_oneof![
        6 => weights.prop_map(Event::Update), 1 => (0u64..4).prop_map(Event::DiscardLast), 1 => Just(Event::Cut)
    ];
    proptest::collection::vec(event, 1..30)
}

proptest! {
    /// Any sequence of updates, cuts and discarded updates: the result slot holds the weights asked for, the
    /// previous slot what was there before, and no access is unordered.
    #[test]
    fn plans_reach_the_weights_without_hazards(desc in descs(), events in events(9)) {
        const TARGETS: usize = 9;
        let mut state = PoseState::new(desc).unwrap();
        let mut slots: Vec<Held> = vec![None; desc.slots as usize];
        // What the device did: the updates that ran, each with the slots drawn after it.
        let mut ran: Vec<(u64, CommandList, Vec<u32>, Vec<Held>)> = vec![];
        let (mut plan, mut update, mut cut) = (Plan::default(), 0u64, false);
        for event in events {
            match event {
                Event::DiscardLast(n) => {
                    // They never ran: the slots are what they were before the first of them.
                    let kept = ran.len().saturating_sub(n as usize);
                    for (number, _, _, before) in ran.drain(kept..).rev() {
                        state.discard_from(number);
                        slots = before;
                    }
                }
                Event::Cut => { state.cut(); cut = true; }
                Event::Update(weights) => {
                    let wanted: Vec<f64> = weights.iter().map(|&w| f64::from(w)).collect();
                    let last = state.applied().map(|w| w.iter().map(|&w| f64::from(w)).collect::<Vec<_>>());
                    update += 1;
                    state.plan(&weights, update, &mut plan);
                    let mut list = CommandList::new(desc.path);
                    list.fill(std::slice::from_ref(&plan));
                    let before = slots.clone();
                    follow(&plan, &mut slots, TARGETS);
                    let held = slots[plan.result as usize].clone().expect("the result is known");
                    prop_assert_eq!(&held, &wanted);
                    prop_assert_eq!(state.applied(), Some(&weights[..]));
                    let still = last.as_ref() == Some(&wanted);
                    let expected = match (last, cut) { (Some(l), false) => l, _ => wanted.clone() };
                    if let Some(previous) = plan.previous {
                        prop_assert_eq!(slots[previous as usize].as_ref(), Some(&expected));
                    } else {
                        prop_assert!(desc.slots == 1 || (!desc.path.works_in_place() && desc.slots == 2));
                    }
                    if plan.passes.is_empty() {
                        prop_assert!(still && list.commands.is_empty());
                    } else {
                        prop_assert_eq!(plan.passes.len(), desc.batch.passes(plan.coefficients.len()));
                    }
                    let drawn = plan.previous.into_iter().chain([plan.result]).collect();
                    ran.push((update, list, drawn, before));
                    cut = false;
                }
            }
        }
        let mut checker = HazardChecker::new();
        checker.upload();
        for (_, list, drawn, _) in &ran {
            checker.update(list);
            drawn.iter().for_each(|&slot| checker.draw(0, slot));
        }
        prop_assert_eq!(checker.finish(), Ok(()));
    }
}

/// An update, and the slots that are drawn after it.
pub(super) type DrawnUpdate = (CommandList, [Option<u32>; 2]);

/// The fourth of `frames` has this many barriers, and the checker misses each that is taken out, and no other.
pub(super) fn assert_barriers_needed(frames: &[DrawnUpdate], count: usize, what: &str) {
    let barriers = frames[3].0.commands.iter().enumerate().filter(|(_, c)| matches!(c, Command::Barrier(_)));
    let barriers: Vec<usize> = barriers.map(|(i, _)| i).collect();
    assert_eq!(barriers.len(), count, "{what}");
    for dropped in barriers.into_iter().map(Some).chain([None]) {
        let mut checker = HazardChecker::new();
        checker.upload();
        checker.upload_animation();
        for (f, (list, drawn)) in frames.iter().enumerate() {
            let mut list = list.clone();
            if let (3, Some(at)) = (f, dropped) {
                list.commands.remove(at);
            }
            checker.update(&list);
            drawn.iter().flatten().for_each(|&slot| checker.draw(0, slot));
        }
        assert_eq!(checker.finish().is_err(), dropped.is_some(), "{what}, dropped {dropped:?}");
    }
}

/// Take any one barrier of a running animation out, and the checker says so.
#[test]
fn every_barrier_is_needed() {
    for path in [UpdatePath::Feedback, UpdatePath::Compute, UpdatePath::VertexStore] {
        for (batch, slots) in [(1, 2), (2, 2), (4, 2), (9, 2), (1, 1), (9, 1)] {
            let desc = UpdateDesc { slots, ..UpdateDesc::new(path, BatchSize::Targets(batch)) };
            let Ok(mut state) = PoseState::new(desc) else { continue };
            let (mut plan, mut list) = (Plan::default(), CommandList::new(path));
            // Three frames to bring the slots round, then the one that is tampered with, then one more.
            let mut frames = vec![];
            for frame in 0..5 {
                let weight = |i: usize| if i % 3 == frame % 3 { 2.0 + frame as f32 } else { 1.0 };
                state.plan(&(0..9).map(weight).collect::<Vec<f32>>(), frame as u64 + 1, &mut plan);
                list.fill(std::slice::from_ref(&plan));
                frames.push((list.clone(), [Some(plan.result), plan.previous]));
            }
            assert_barriers_needed(&frames, 6usize.div_ceil(batch as usize) + 1, &format!("{desc:?}"));
        }
    }
}

/// The four barriers of `scatter`: before the sums are cleared, and after each step.
#[test]
fn every_barrier_of_scatter_is_needed() {
    for slots in 1..4 {
        let desc = UpdateDesc { slots, ..UpdateDesc::new(UpdatePath::Scatter, BatchSize::All) };
        let mut states = vec![PoseState::new(desc).unwrap(); 2];
        let (mut plans, mut list) = (vec![Plan::default(); 2], CommandList::new(desc.path));
        let mut frames = vec![];
        for frame in 0..5u8 {
            // The second head is still every other frame.
            for (weight, (state, plan)) in [frame, frame / 2].into_iter().zip(states.iter_mut().zip(&mut plans)) {
                state.plan(&[f32::from(weight), 1.0], u64::from(frame) + 1, plan);
            }
            list.fill_scatter(&plans);
            frames.push((list.clone(), [Some(plans[0].result), plans[0].previous]));
        }
        assert_barriers_needed(&frames, 4, &format!("{desc:?}"));
        let steps = |frame: usize| frames[frame].0.commands.iter().filter(|c| matches!(c, Command::Scatter(_))).count();
        assert_eq!([steps(2), steps(3)], [6, 3], "a head that is still records nothing");
        assert_eq!(frames[2].0.coefficients.len(), 4);
    }
}

#[test]
fn a_swapped_ping_pong_slot_is_seen() {
    for path in [UpdatePath::Feedback, UpdatePath::Compute] {
        let desc = UpdateDesc::new(path, BatchSize::Targets(1));
        let mut state = PoseState::new(desc).unwrap();
        let (mut plan, mut slots) = (Plan::default(), vec![None; 2]);
        state.plan(&[1.0, 1.0, 1.0], 1, &mut plan);
        follow(&plan, &mut slots, 3);
        state.plan(&[1.0, 0.5, 1.0], 2, &mut plan);
        assert_eq!(plan.passes.len(), 1);
        let Source::Slot(source) = plan.passes[0].source else { panic!("{plan:?}") };
        let pass = &mut plan.passes[0];
        (pass.source, pass.destination) = (Source::Slot(pass.destination), source);
        follow(&plan, &mut slots, 3);
        assert_ne!(slots[plan.result as usize], Some(vec![1.0, 0.5, 1.0]), "{path:?}");
    }
}

#[test]
fn a_vertex_pass_must_not_write_what_it_fetches() {
    for path in [UpdatePath::Feedback, UpdatePath::VertexStore] {
        let mut state = PoseState::new(UpdateDesc::new(path, BatchSize::Targets(2))).unwrap();
        let (mut plan, mut list) = (Plan::default(), CommandList::new(path));
        state.plan(&[1.0, 2.0, 3.0], 1, &mut plan);
        plan.passes[1].destination = plan.passes[0].destination;
        list.fill(std::slice::from_ref(&plan));
        let mut checker = HazardChecker::new();
        checker.upload();
        checker.update(&list);
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
        let mut state = PoseState::new(UpdateDesc::new(path, batch)).unwrap();
        let mut list = CommandList::new(path);
        let (mut weights, mut plan) = (vec![0.5; 57], Plan::default());
        state.plan(&weights, 1, &mut plan);
        assert_eq!(plan.passes.len(), batch.passes(57));
        weights[33] = -0.25;
        state.plan(&weights, 2, &mut plan);
        assert_eq!((plan.passes.len(), plan.coefficients.len(), plan.rebuilt), (1, 1, false));
        assert_eq!(plan.coefficients[0], Coefficient { target: 33, value: -0.75 });
        state.plan(&weights, 3, &mut plan);
        list.fill(std::slice::from_ref(&plan));
        assert!(list.commands.is_empty() && plan.previous == Some(plan.result));
    }
}

#[test]
fn rounds_of_a_crowd_share_their_barriers() {
    let desc = UpdateDesc::new(UpdatePath::Compute, BatchSize::Targets(2));
    let plans: Vec<Plan> = [vec![1.0, 1.0, 1.0], vec![1.0, 0.0, 0.0], vec![0.0; 3]]
        .iter()
        .map(|weights| {
            let (mut state, mut plan) = (PoseState::new(desc).unwrap(), Plan::default());
            state.plan(weights, 1, &mut plan);
            plan
        })
        .collect();
    let mut list = CommandList::new(UpdatePath::Compute);
    list.fill(&plans);
    let shape: Vec<Option<u32>> = list
        .commands
        .iter()
        .map(|c| match c {
            Command::Pass(p) => Some(p.instance),
            Command::Barrier(_) | Command::Blocks(_) | Command::Scatter(_) | Command::Animated(_) => None,
        })
        .collect();
    assert_eq!(shape, [None, Some(0), Some(1), Some(2), None, Some(0), None]);
    assert_eq!(list.commands.last(), Some(&Command::Barrier(Hazard::ComputeWriteToPoseRead)));
    assert_eq!(list.bytes_moved(64, 24, 12), 64 * (4 * 48 + 4 * 12));
    assert_eq!(list.bytes_floor(64, 24, 12), 64 * (3 * 48 + 4 * 12));
}

#[test]
fn bad_descriptions_are_refused() {
    for (desc, words) in [
        (UpdateDesc { slots: 1, ..UpdateDesc::new(UpdatePath::Feedback, BatchSize::Targets(1)) }, "2 to 64 slots"),
        (UpdateDesc { slots: 0, ..UpdateDesc::new(UpdatePath::Compute, BatchSize::All) }, "1 to 64 slots"),
        (UpdateDesc::new(UpdatePath::Compute, BatchSize::Targets(0)), "batch size of 0"),
        (UpdateDesc::new(UpdatePath::Feedback, BatchSize::All), "vertex attributes"),
    ] {
        let text = desc.check().unwrap_err().to_string();
        assert!(text.contains(words), "{text}");
    }
}
