//! A day of frames: crowds are made and dropped, hide, cut, lose updates and change levels of detail. Poses stay exact
//! and memory constant, and counters wrap.
//!
//! `DELTAMORPH_FRAMES` sets the number of frames; 5,184,000 are 24 hours at 60 per second. Without it a short run uses
//! the validation layers.

mod crowds;

use crate::prelude::*;
use crowds::{Animated, Loose, Weighted};
use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hasher};
use std::time::Instant;

/// Frames per submission: updates in flight.
const BATCH: u32 = 16;
/// Submissions between comparisons of all poses.
const COMPARED: u32 = 8;
/// The clock of updates, in steps of 2⁻¹⁶ s, wraps here, in the middle of a run.
const CLOCK_WRAPS: f64 = 65_536.0;
const RATE: f64 = 60.0;
/// From this many frames on, a tenth of them covers all events many times.
const SETTLED: u32 = 200_000;

/// Counts of events.
type Counts = BTreeMap<&'static str, u64>;

#[test]
fn crowds_live_through_a_day() {
    let lavapipe = "llvmpipe";
    match std::env::var("DELTAMORPH_FRAMES") {
        Ok(frames) => {
            let device = DeviceChoice::Name(lavapipe.into());
            let headless = Headless::new(&HeadlessDesc { device, ..Default::default() }).expect("lavapipe");
            live(&headless, frames.parse().expect("a number of frames"), near_the_wrap());
        }
        // Numbers of updates and cuts beyond 32 bits have no effect.
        Err(_) => gpu::on_device(lavapipe, false, |headless, _| {
            assert_eq!(live(headless, 1_200, 0), live(headless, 1_200, near_the_wrap()));
        }),
    }
}

/// Returns a start for numbers of updates and epochs that soon exceeds 32 bits.
fn near_the_wrap() -> u64 {
    u64::from(u32::MAX) - 100
}

/// Returns the resident memory of the process, and the memory that the engine's allocator holds, in KiB.
fn memory(headless: &Headless) -> [u64; 2] {
    let status = std::fs::read_to_string("/proc/self/status").expect("Linux");
    let resident = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("a line of memory");
    let resident = resident.trim_end_matches("kB").trim().parse().expect("a number");
    [resident, headless.engine().memory().allocated / 1024]
}

/// Animates all crowds for `frames` frames, with update numbers from `begin`; returns a digest of the compared poses.
fn live(headless: &Headless, frames: u32, begin: u64) -> u64 {
    let mut rng = Rng::new(11, 0);
    let fixed = |pose, slots| UpdateDesc { pose, slots, weight_max: Some(4.0), ..UpdateDesc::blocks() };
    let mut weighted = [
        Weighted::new(headless, DeltaFormat::Fast, fixed(PoseFormat::Fixed32, 2), begin),
        Weighted::new(headless, DeltaFormat::Small, fixed(PoseFormat::Fixed16, 3), begin),
        Weighted::new(headless, DeltaFormat::Fast, UpdateDesc { tolerance: 1e-2, ..UpdateDesc::blocks() }, begin),
    ];
    let mut animated = Animated::new(headless, fixed(PoseFormat::Fixed16, 2), begin);
    let (mut counts, mut digest) = (Counts::new(), DefaultHasher::new());
    let (started, first_second) = (Instant::now(), (CLOCK_WRAPS - f64::from(frames) / RATE / 2.0).max(0.0));
    let batches = frames.div_ceil(BATCH);
    let (mut early, mut last) = ([0; 2], [0; 2]);
    println!("| frames | seconds | VmRSS, KiB | of the device, KiB |\n|---|---|---|---|");
    for batch in 0..batches {
        let second = |frame: u32| first_second + f64::from(batch * BATCH + frame) / RATE;
        if rng.below(16) == 0 {
            lose(headless, &mut rng, &mut weighted, &mut animated, &mut counts, second(0));
        }
        let ran = headless.run(|cmd| {
            let mut loose = Loose::default();
            for frame in 0..BATCH {
                for crowd in &mut weighted {
                    crowd.come_and_go(&mut rng, &mut counts, &mut loose);
                    crowd.change(&mut rng, &mut counts)?;
                }
                animated.come_and_go(cmd, &mut rng, &mut counts, &mut loose)?;
                animated.change(&mut rng, &mut counts, second(frame))?;
                record(headless, cmd, &mut weighted, &mut animated)?;
                weighted.iter_mut().for_each(|crowd| crowd.ran(&mut counts));
                animated.ran(&mut counts);
            }
            Ok(loose)
        });
        drop(ran.expect("a batch of frames"));
        animated.release();
        if batch % COMPARED == 0 || batch + 1 == batches {
            weighted.iter_mut().for_each(|crowd| crowd.compare(&mut counts, &mut digest));
            animated.compare(&mut counts, &mut digest);
        }
        if batch == batches / 10 || (batch + 1) % batches.div_ceil(10) == 0 || batch == 0 || batch + 1 == batches {
            last = memory(headless);
            let (frames, seconds) = ((batch + 1) * BATCH, started.elapsed().as_secs());
            println!("| {frames} | {seconds} | {} | {} |", last[0], last[1]);
        }
        if batch == batches / 10 {
            early = last;
        }
    }
    counts.iter().for_each(|(what, times)| println!("{what}: {times}"));
    println!("digest of poses and levels: {:016x}", digest.finish());
    // Changing objects change the memory in use, and lavapipe and the C library keep some freed memory.
    let [resident, of_device] = [0, 1].map(|i| last[i].saturating_sub(early[i]));
    assert!(
        frames < SETTLED || resident <= 8 * 1024 && of_device <= 4 * 1024,
        "memory grew from {early:?} KiB after a tenth of the frames to {last:?}"
    );
    digest.finish()
}

/// Records the updates of all crowds.
fn record(
    headless: &Headless,
    cmd: deltamorph::ash::vk::CommandBuffer,
    weighted: &mut [Weighted<'_>],
    animated: &mut Animated<'_>,
) -> deltamorph::Result<Vec<deltamorph::Update>> {
    let mut all: Vec<&mut Crowd> = weighted.iter_mut().map(|this| &mut this.crowd).collect();
    all.push(&mut animated.crowd);
    // SAFETY: the buffer records on the engine's device; it is waited for, or never runs and its updates are discarded.
    unsafe { headless.engine().record_updates(cmd, &mut all) }
}

/// Loses a submission: all its updates are discarded.
fn lose(
    headless: &Headless,
    rng: &mut Rng,
    weighted: &mut [Weighted<'_>],
    animated: &mut Animated<'_>,
    counts: &mut Counts,
    second: f64,
) {
    let mut first = None;
    let frames = 1 + rng.below(4);
    let lost = headless.run(|cmd| {
        for _ in 0..frames {
            for crowd in &mut *weighted {
                crowd.change(rng, counts)?;
            }
            animated.change(rng, counts, second)?;
            let updates = record(headless, cmd, weighted, animated)?;
            first.get_or_insert(updates);
        }
        // The buffer is not submitted.
        Err::<(), _>(Error::Invalid { what: "lost".into(), remedy: String::new() })
    });
    assert!(lost.is_err_and(|error| error.to_string().starts_with("lost")));
    let tickets = first.into_iter().flatten().map(|update| update.ticket).collect::<Vec<_>>();
    for (crowd, ticket) in weighted.iter_mut().zip(&tickets) {
        crowd.crowd.discard(*ticket).expect("a ticket of this crowd");
    }
    animated.crowd.discard(tickets[weighted.len()]).expect("a ticket of this crowd");
    *counts.entry("updates of all crowds discarded").or_default() += frames as u64;
}
