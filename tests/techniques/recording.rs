//! Recording without submitting: updates that are delayed, dropped, reset, or recorded twice before they run.

use super::table::{can_read, for_every_update, keep_supported, variants};
use crate::gpu::assert_right;
use crate::prelude::*;
use deltamorph::DeltaFormat::{Fast, Float32, Small, Snorm16};
use deltamorph::UpdateStats;

/// Runs `test` for every technique and batch size of every device, on fresh crowds that have shown two frames;
/// techniques of others in every mode, with one to three slots.
fn with_crowds(test: impl for<'a> Fn(&'a Headless, &dyn Fn() -> HeadlessCrowd<'a>, &PackedMesh, UpdateDesc)) {
    for_every_update(&[Float32, Snorm16, Fast, Small], &testing::mesh(300, 23), |headless, mesh, desc| {
        let of_others = desc.path.is_baseline();
        let descs: Vec<_> = if of_others { variants(desc).collect() } else { vec![desc] };
        for desc in descs.into_iter().filter(|_| of_others || mesh.layout().format != Float32) {
            let fresh = || {
                let mut crowd = gpu::crowd(headless, mesh, desc);
                (0..2).for_each(|frame| _ = crowd.step(&[&weights(mesh, &desc, frame)]).expect("a step"));
                crowd
            };
            test(headless, &fresh, mesh, desc);
        }
    });
}

/// Returns the weights of a frame, up to 9; plus 10: with one more target; plus 20: with two.
fn weights(mesh: &PackedMesh, desc: &UpdateDesc, frame: u32) -> Vec<f32> {
    let mut weights = gpu::weights(mesh, frame % 10, 9);
    weights[5..].iter_mut().zip([0.5, 0.25]).take(frame as usize / 10).for_each(|(weight, more)| *weight += more);
    keep_supported(&mut weights, desc);
    weights
}

/// Actions of a host, and expected results. `record 2`: with the weights of frame 2, as `step`; `submit 0 1`, `discard
/// 0`: the updates recorded first and second; `right 3`, `wrong 3`: the pose is that of frame 3, or is not, since an
/// update was assumed to have run; `no pose`: draws are refused; `rebuilt`: the last step began with the base pose;
/// `empty`: the last recorded update does nothing.
const HISTORIES: [(&str, &str); 9] = [
    ("a discarded update is rebuilt", "record 2, discard 0, no pose, step 3, rebuilt, right 3, step 4, right 4"),
    ("without the discard the pose would be wrong", "record 13, step 23, wrong 23"),
    ("of two updates the second is discarded", "record 2, record 3, submit 0, discard 1, step 4, right 4"),
    // The same weights again, as after recreating the swapchain and restarting the frame.
    ("a reset command buffer is recorded again", "record 2, discard 0, record 2, submit 1, right 2"),
    // In one submission, with the coefficients of the first unchanged.
    ("two are recorded before either is submitted", "record 2, record 3, submit 0 1, right 3"),
    (
        "submission lags one frame behind recording: always two updates recorded and not finished",
        "record 2, record 3, submit 0, record 4, submit 1, record 5, submit 2, record 6, submit 3, record 7, submit 4, \
         submit 5, right 7",
    ),
    // Again, while the second may be running: its poses and its part of the ring are unchanged.
    ("a ticket is good for one discard", "record 2, discard 0, record 3, discard 0, submit 1, right 3"),
    (
        "updates are discarded in any order, and tickets stay spent, that of an update that did nothing as well",
        "record 2, record 3, discard 1, discard 0, no pose, step 4, discard 0, discard 1, right 4, \
         record 4, empty, discard 2, record 5, discard 2, submit 3, right 5",
    ),
    (
        // One update is pending, then one is dropped; the pending one finds its own coefficients. Then one is pending
        // and one records nothing: if the last had overwritten the list of the first, which is incremental, target 5
        // would be wrong.
        "a discarded or empty update does not turn the ring of coefficients",
        "record 2, record 3, discard 1, no pose, record 3, submit 0, submit 2, right 3, \
         record 13, record 13, empty, record 23, submit 3 4 5, right 23",
    ),
];

#[test]
fn histories_of_updates_that_are_delayed_discarded_and_recorded_again() {
    with_crowds(|headless, fresh, mesh, desc| {
        for (name, history) in HISTORIES {
            let (mut crowd, mut tickets, mut waiting) = (fresh(), vec![], vec![]);
            let (mut stats, draws) = (UpdateStats::default(), desc.path.evaluates_in_draws());
            for what in history.split(", ") {
                let (verb, rest) = what.split_once(' ').unwrap_or((what, ""));
                let numbers: Vec<u32> = rest.split(' ').filter_map(|number| number.parse().ok()).collect();
                let asked = numbers.first().map(|frame| weights(mesh, &desc, *frame)).unwrap_or_default();
                let context = format!("{name}: {what}, {desc:?}");
                match verb {
                    "record" => {
                        let (recorded, update) = crowd.record(&[&asked]).expect(&context);
                        waiting.push(Some(recorded));
                        tickets.push(update.ticket);
                        stats = update.stats;
                    }
                    "submit" => {
                        let them = numbers.iter().map(|i| waiting[*i as usize].take().expect("recorded once"));
                        crowd.submit(them.collect()).expect(&context);
                    }
                    "discard" => crowd.discard(tickets[numbers[0] as usize]).expect(&context),
                    "step" => stats = crowd.step(&[&asked]).expect(&context).update.stats,
                    "right" if can_read(headless, &desc) => assert_right(&mut crowd, 0, mesh, &asked),
                    "wrong" if desc.mode == UpdateMode::Incremental && !draws => {
                        // Unwritten memory may be NaN.
                        let error = gpu::error(&mut crowd, 0, mesh, &asked);
                        assert!(!error.within(1e-3, f64::INFINITY), "{context}: proves nothing");
                    }
                    "no" if !draws => {
                        let text = crowd.draw(Draws { copies: 1, passes: 2 }).expect_err(&context).to_string();
                        assert!(text.contains("no pose yet") && crowd.crowd().pose(0).is_err(), "{context}: {text}");
                    }
                    "rebuilt" => {
                        let blocks = stats.dirty_blocks > 0 && stats.rebuilt_blocks == stats.dirty_blocks;
                        assert!(draws || stats.rebuilt == 1 || blocks, "{context}");
                    }
                    "empty" => assert!(draws || (stats.passes, stats.bytes_moved) == (0, 0), "{context}"),
                    "right" | "wrong" | "no" => {}
                    _ => panic!("no such thing to do: {context}"),
                }
            }
        }
    });
}

#[test]
fn recorded_updates_run_in_their_crowd_and_while_their_lists_are_theirs() {
    with_crowds(|headless, fresh, mesh, desc| {
        if desc.path.evaluates_in_draws() {
            return;
        }
        let mut crowd = fresh();
        let mut other = gpu::crowd(headless, mesh, desc);
        let (foreign, of_other) = other.record(&[&weights(mesh, &desc, 2)]).expect("a recording");
        testing::says(crowd.submit(vec![foreign]), &["the oldest ones that wait in this crowd"]);
        testing::says(crowd.discard(of_other.ticket), &["another crowd"]);
        drop(other);

        let (discarded, update) = crowd.record(&[&weights(mesh, &desc, 2)]).expect("a recording");
        crowd.discard(update.ticket).expect("a ticket of this crowd");
        testing::says(crowd.submit(vec![discarded]), &["the oldest ones that wait"]);

        let (first, _) = crowd.record(&[&weights(mesh, &desc, 2)]).expect("a recording");
        let (second, _) = crowd.record(&[&weights(mesh, &desc, 3)]).expect("a recording");
        // Two frames in flight: a third would overwrite the list of the first.
        testing::says(crowd.record(&[&weights(mesh, &desc, 4)]), &["2 updates wait"]);
        testing::says(crowd.submit(vec![second, first]), &["the oldest ones that wait"]);

        let (left, update) = {
            crowd.step(&[&weights(mesh, &desc, 5)]).expect("a step");
            crowd.record(&[&weights(mesh, &desc, 6)]).expect("a recording")
        };
        let step = crowd.step(&[&weights(mesh, &desc, 7)]).expect("a step");
        testing::says(crowd.submit(vec![left]), &["the oldest ones that wait"]);
        testing::says(crowd.discard(update.ticket), &["left behind by a step"]);
        testing::says(crowd.discard(step.update.ticket), &["it was submitted"]);
    });
}
