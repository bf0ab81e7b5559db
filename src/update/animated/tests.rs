use super::reference::{interpolate, key, sample};
use super::sample::TICKS_PER_SECOND;
use super::*;
use crate::pack::blocks::PoseGrid;
use crate::pack::{DeltaFormat, PackDesc, PackedMesh, PoseFormat};
use crate::plan::hazards::animated;
use crate::plan::instances::InstanceState;
use crate::plan::steps::Steps;
use crate::plan::tests::{assert_barriers_needed, scheduled};
use crate::plan::{Consumers, UpdateDesc, UpdatePath};
use crate::testing;
use crate::weights::{Repeat, WeightClip};
use proptest::prelude::*;

const TARGETS: usize = 5;

fn mesh() -> PackedMesh {
    PackedMesh::pack(&testing::mesh(100, TARGETS), &PackDesc::new(DeltaFormat::Small)).unwrap()
}

fn grid() -> PoseGrid {
    mesh().layout().grid(PoseFormat::Fixed32, None).unwrap()
}

fn clip(frames: usize, fps: f32, value: impl Fn(usize, usize) -> f32) -> WeightClip {
    let names = (0..TARGETS).map(|t| format!("target_{t}")).collect();
    let values = (0..frames * TARGETS).map(|i| value(i / TARGETS, i % TARGETS)).collect();
    WeightClip { name: "clip".into(), names, fps, values, notes: vec![] }
}

fn clips(list: &[WeightClip], key_format: KeyFormat) -> Clips {
    Clips::new(&AnimationDesc { key_format, ..AnimationDesc::new(list) }, mesh().layout(), grid()).unwrap()
}

/// Weights at `seconds`, in double precision.
fn expected(clip: &WeightClip, playback: &Playback, seconds: f64) -> Vec<f64> {
    let frames = clip.frame_count() as f64;
    let mut at = (seconds - playback.start).max(0.0) * playback.speed.abs() * f64::from(clip.fps);
    at = match playback.repeat {
        Repeat::Loop => at.rem_euclid(frames),
        Repeat::Once => at.min(frames - 1.0),
    };
    let (frame, f) = (at.floor(), at.fract());
    let key = |frame: f64, t: usize| {
        let frame = frame.rem_euclid(frames);
        let frame = if playback.speed < 0.0 { frames - 1.0 - frame } else { frame };
        f64::from(clip.values[frame as usize * TARGETS + t])
    };
    (0..TARGETS).map(|t| key(frame, t) * (1.0 - f) + if f > 0.0 { key(frame + 1.0, t) * f } else { 0.0 }).collect()
}

proptest! {
    /// For any clip, key format, speed and time: weights match interpolation in double precision, within the rounding
    /// of grid, keys and time.
    #[test]
    fn weights_are_interpolated(
        frames in 1usize..20, seed in any::<u32>(), short in any::<bool>(), speed in -3.0..3.0f64,
        start in -5.0..20.0f64, once in any::<bool>(), seconds in prop::collection::vec(0.0..40.0f64, 1..20),
    ) {
        let value = |f: usize, t: usize| ((f as u32 * 31 + t as u32 * 7) ^ seed).wrapping_mul(0x9E37_79B9) as f32 / 2e9 - 1.0;
        let clip = clip(frames, 30.0, value);
        let format = if short { KeyFormat::Bits16 } else { KeyFormat::Bits32 };
        let clips = clips(std::slice::from_ref(&clip), format);
        let grid = grid();
        let playback = Playback { clip: 0, start, speed, repeat: if once { Repeat::Once } else { Repeat::Loop } };
        let mut playbacks = Playbacks::new(1);
        playbacks.play(0, &playback, &clips).unwrap();
        for seconds in seconds {
            playbacks.set_time(seconds).unwrap();
            playbacks.update(&clips);
            let steps = sample(&clips, &playbacks.records()[0], playbacks.now());
            // Ticks, rates and positions are rounded. Near a frame, both neighbours count.
            let slack = 3.0 * 90.0 / TICKS_PER_SECOND + 60.0 / 65_536.0;
            let most = f64::from(grid.weight_step()) + f64::from(clips.rounding(0).unwrap()) + 2.0 * slack;
            let place = slack / (speed.abs() * 30.0).max(1e-9);
            for (t, &steps) in steps.iter().enumerate() {
                let weight = f64::from(steps) * f64::from(grid.weight_step());
                let near = [-place, 0.0, place].map(|d| (expected(&clip, &playback, seconds + d)[t] - weight).abs());
                prop_assert!(near.iter().any(|d| *d <= most), "{near:?} {most} at {seconds}");
            }
        }
    }

    /// A rebased record continues at exactly its position, even if the clock goes back.
    #[test]
    fn a_record_started_anew_goes_on_where_it_was(
        frames in 1usize..50, fps in 1.0..120.0f32, speed in -2.0..2.0f64, once in any::<bool>(),
        times in prop::collection::vec(0.0..100_000.0f64, 1..30),
    ) {
        let clips = clips(&[clip(frames, fps, |f, t| (f * 3 + t) as f32 / 200.0)], KeyFormat::Bits32);
        let repeat = if once { Repeat::Once } else { Repeat::Loop };
        let mut playbacks = Playbacks::new(1);
        playbacks.play(0, &Playback { speed, repeat, ..Playback::new(0) }, &clips).unwrap();
        let first = playbacks.records()[0];
        let mut times = times;
        times.sort_by(f64::total_cmp);
        for seconds in times.into_iter().flat_map(|t| [t, t - 0.5, t - 3500.0]).filter(|t| *t >= 0.0) {
            playbacks.set_time(seconds).unwrap();
            playbacks.update(&clips);
            let record = playbacks.records()[0];
            // The exact value, in 128 bits.
            let at = (seconds * TICKS_PER_SECOND).round() as u128 * u128::from(first.rate);
            let whole = (frames as u128) << 32;
            let at = if once { at.min(whole - (1 << 32)) } else { at % whole };
            let elapsed = playbacks.now().wrapping_sub(record.start) as i32;
            prop_assert_eq!(u128::from(record.position(frames as u32, elapsed.max(0).into())), at);
        }
    }

    /// No key loses more than `rounding`, and none exceeds the limit of sums.
    #[test]
    fn short_keys_lose_what_is_stated(scale in 0.001..4.0f32, seed in any::<u32>()) {
        let value = |f: usize, t: usize| {
            let x = ((f * TARGETS + t) as u32 ^ seed).wrapping_mul(0x85EB_CA6B) >> 8;
            ((x as f32 / (1u32 << 23) as f32 - 1.0) * scale).clamp(-4.0, 4.0)
        };
        let list = [clip(9, 24.0, value), clip(2, 24.0, |_, _| 4.0), clip(2, 24.0, |_, t| t as f32 * 1e-3)];
        let (long, short) = (clips(&list, KeyFormat::Bits32), clips(&list, KeyFormat::Bits16));
        let grid = grid();
        for clip in 0..3 {
            prop_assert_eq!(long.rounding(clip), Some(0.0));
            for (frame, t) in (0..long.frame_count(clip)).flat_map(|f| (0..TARGETS).map(move |t| (f, t))) {
                let (exact, kept) = (key(&long, clip, frame, t), key(&short, clip, frame, t));
                prop_assert!((exact - kept).abs() as f32 * grid.weight_step() <= short.rounding(clip).unwrap());
                prop_assert!(kept.abs() <= grid.steps(grid.weight_max));
            }
        }
        let range = scale.max(1e-3);
        prop_assert!(short.rounding(0).unwrap() <= range / 32_767.0 + 1e-9, "{} of {range}", short.rounding(0).unwrap());
    }
}

#[test]
fn interpolation_rounds_to_nearest_and_reaches_both_ends() {
    assert_eq!(interpolate(-7, 100, 0), -7);
    assert_eq!((interpolate(0, 1, 0x7fff), interpolate(0, 1, 0x8000)), (0, 1));
    assert_eq!((interpolate(0, -1, 0x8000), interpolate(0, -1, 0x8001)), (0, -1));
    let most = 1 << 24;
    assert_eq!(interpolate(-most, most, 0x8000), 0);
    assert_eq!(interpolate(most, -most, 0xffff), most - ((i64::from(most) * 2 * 0xffff + 0x8000) >> 16) as i32);
}

/// First and end of each range of records that the last update sends.
fn runs(playbacks: &Playbacks) -> Vec<(u32, u32)> {
    playbacks.changed().iter().map(|run| (run.start, run.end)).collect()
}

#[test]
fn what_is_played_is_sent_once_and_again_when_it_was_discarded() {
    let clips = clips(&[clip(4, 24.0, |f, _| f as f32 / 8.0)], KeyFormat::Bits32);
    let mut playbacks = Playbacks::new(4);
    for instance in [0, 1, 3] {
        playbacks.play(instance, &Playback::new(0), &clips).unwrap();
    }
    assert_eq!((playbacks.update(&clips), runs(&playbacks)), (0, vec![(0, 2), (3, 4)]));
    assert_eq!((playbacks.update(&clips), runs(&playbacks)), (1, vec![]));
    playbacks.set_hidden(2, true);
    playbacks.reset_history(0);
    assert_eq!((playbacks.update(&clips), runs(&playbacks)), (2, vec![(2, 3)]));
    playbacks.discard_from(2);
    playbacks.set_hidden(2, false);
    assert_eq!((playbacks.update(&clips), runs(&playbacks)), (2, vec![(2, 3)]));
    assert_eq!((playbacks.update(&clips), runs(&playbacks)), (3, vec![]));
    playbacks.discard_from(0);
    assert_eq!((playbacks.update(&clips), runs(&playbacks)), (0, vec![(0, 4)]));
}

/// Discards restore the state before them as far as it is remembered, and invent nothing beyond that.
#[test]
fn discarded_updates_change_nothing() {
    let clips = clips(&[], KeyFormat::Bits32);
    for (updates, discarded) in (1..13).flat_map(|updates| (0..=updates).map(move |discarded| (updates, discarded))) {
        let mut playbacks = Playbacks::new(2);
        let written = |playbacks: &Playbacks| [playbacks.written(0), playbacks.written(1)];
        let mut before = vec![written(&playbacks)];
        for update in 0..updates {
            playbacks.set_hidden(0, update % 2 == 1);
            playbacks.reset_history(1);
            playbacks.update(&clips);
            before.push(written(&playbacks));
        }
        playbacks.discard_from(updates - discarded);
        for (now, expected) in written(&playbacks).into_iter().zip(before[(updates - discarded) as usize]) {
            let forgotten = discarded >= 8 && now.is_none();
            assert!(now == expected || forgotten, "{updates} {discarded}: {now:?}, {expected:?}");
        }
    }
}

#[test]
fn a_reset_survives_a_discarded_update_that_hides_its_instance() {
    let clips = clips(&[], KeyFormat::Bits32);
    let mut playbacks = Playbacks::new(1);
    (0..2).for_each(|update| assert_eq!(playbacks.update(&clips), update));
    playbacks.reset_history(0);
    playbacks.set_hidden(0, true);
    assert_eq!(playbacks.update(&clips), 2);
    playbacks.discard_from(2);
    playbacks.set_hidden(0, false);
    assert_eq!((playbacks.update(&clips), playbacks.written(0)), (2, Some((2, false))));
    assert_eq!((playbacks.update(&clips), playbacks.written(0)), (3, Some((3, true))));
}

#[test]
fn what_cannot_be_played_is_refused() {
    let mesh = mesh();
    let refuse = |clip: WeightClip, words: &str| {
        let list = [clip];
        testing::says(Clips::new(&AnimationDesc::new(&list), mesh.layout(), grid()), &[words]);
    };
    let large = |f, t| if (f, t) == (1, 3) { 4.5 } else { 0.0 };
    refuse(clip(3, 30.0, large), "frame 1, target 'target_3': the weight is 4.5");
    refuse(clip(0, 30.0, |_, _| 0.0), "0 frames");
    refuse(clip(1, 0.0, |_, _| 0.0), "0 frames a second");
    refuse(WeightClip { names: vec!["jaw".into()], values: vec![0.0], ..clip(1, 30.0, |_, _| 0.0) }, "'jaw'");

    let clips = clips(&[clip(2, 30.0, |_, _| 0.0)], KeyFormat::Bits16);
    let mut playbacks = Playbacks::new(1);
    let good = Playback::new(0);
    for (playback, words) in [
        (Playback { clip: 1, ..good }, "clip 1 of 1"),
        (Playback { speed: f64::NAN, ..good }, "a speed of NaN"),
        (Playback { speed: 1e6, ..good }, "at most 65535 frames"),
        (Playback { start: f64::INFINITY, ..good }, "second inf"),
        (Playback { start: 20_000.0, ..good }, "20000 seconds ahead"),
    ] {
        testing::says(playbacks.play(0, &playback, &clips), &[words]);
    }
    playbacks.set_time(1e6).unwrap();
    playbacks.play(0, &Playback { start: 1e6, ..good }, &clips).unwrap();
    assert!(playbacks.set_time(1e5).unwrap_err().to_string().contains("play its clip again"));
    playbacks.play(0, &Playback { start: 1e5, ..good }, &clips).unwrap();
    playbacks.set_time(1e5).unwrap();
}

#[test]
fn what_is_not_animated_on_the_gpu_is_refused() {
    let fixed = UpdateDesc { pose: PoseFormat::Fixed32, ..UpdateDesc::blocks() };
    let still = PackedMesh::pack(&testing::mesh(10, 0), &PackDesc::new(DeltaFormat::Small)).unwrap();
    for (desc, mesh, words) in [
        (UpdateDesc::blocks(), mesh(), "sums of integers do not drift"),
        (UpdateDesc { slots: 33, ..fixed }, mesh(), "use at most 32"),
        (UpdateDesc { path: UpdatePath::Cpu, ..fixed }, mesh(), "use the path 'blocks'"),
        (UpdateDesc { error_budget: 0.1, ..fixed }, mesh(), "an error budget of 0.1"),
        (fixed, still, "move nothing"),
    ] {
        testing::says(desc.check_animated(mesh.layout()), &[words]);
    }
}

/// Removing any one barrier of a running animation makes the checker fail.
#[test]
fn every_barrier_is_needed() {
    for (slots, records, texels) in [(1, false, false), (2, true, false), (3, true, false), (2, false, true)] {
        let frames: Vec<_> = (0..6u32)
            .map(|frame| {
                let (source, destination) = ((frame + slots - 1) % slots, frame % slots);
                let (groups, dispatches) = (2, 3);
                let update = AnimatedUpdate { records, source, destination, groups, dispatches, texels };
                let mut steps = Steps::new(Consumers::default());
                update.fill(&mut steps);
                let events = scheduled(&[&steps], |_, works| works.iter().map(|work| animated(work, 1)).collect());
                (events, [Some(destination), (slots > 1 && frame > 0).then_some(source)])
            })
            .collect();
        // None before sampling: the barriers of the previous update order it.
        let barriers = 4 + 2 * usize::from(records) + 2 * usize::from(texels);
        assert_barriers_needed(&frames, barriers, &format!("{slots} slots, records {records}, texels {texels}"));
    }
}
