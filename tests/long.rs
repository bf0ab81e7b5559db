//! A day of frames: crowds are made and dropped, hide, cut, lose updates and change levels of detail. Poses stay exact
//! and memory constant, and counters wrap.
//!
//! `DELTAMORPH_FRAMES` sets the number of frames; 5,184,000 are 24 hours at 60 per second. Without it a short run uses
//! the validation layers.

use crate::prelude::*;
use crate::scene::{Scene, full_evaluations};
use deltamorph::lod::Importance;
use deltamorph::{Repeat, Result};
use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hasher};
use std::time::Instant;

const TARGETS: usize = 12;
/// Frames per submission: updates in flight.
const BATCH: u32 = 16;
/// Submissions between comparisons of all poses.
const COMPARED: u32 = 8;
/// The clock of updates, in steps of 2⁻¹⁶ s, wraps here, in the middle of a run.
const CLOCK_WRAPS: f64 = 65_536.0;
const RATE: f64 = 60.0;
/// From this many frames on, a tenth of them covers all events many times.
const SETTLED: u32 = 10_000;
/// A start for numbers of updates and epochs that soon exceeds 32 bits, a multiple of any number of slots here.
const NEAR_THE_WRAP: u64 = (1 << 32) - 100;

/// Counts of events.
type Counts = BTreeMap<&'static str, u64>;

#[test]
fn crowds_live_through_a_day() {
    match std::env::var("DELTAMORPH_FRAMES") {
        Ok(frames) => {
            let headless = gpu::device("llvmpipe", false, None);
            live(&headless, frames.parse().expect("a number of frames"), NEAR_THE_WRAP);
        }
        // Numbers of updates and cuts beyond 32 bits have no effect.
        Err(_) => gpu::on_device("llvmpipe", false, |headless, _| {
            assert_eq!(live(headless, 1_200, 0), live(headless, 1_200, NEAR_THE_WRAP));
        }),
    }
}

fn packed(format: DeltaFormat) -> Arc<PackedMesh> {
    let blocks = BlockDesc { size: Some(32), ..Default::default() };
    let mesh = PackedMesh::pack(&testing::mesh(96, TARGETS), &PackDesc { blocks, ..PackDesc::new(format) });
    Arc::new(mesh.expect("a mesh that packs"))
}

/// Returns a description with any number of places.
fn described(rng: &mut Rng, update: UpdateDesc) -> CrowdDesc {
    CrowdDesc { instances: 2 + rng.below(5) as u32, frames_in_flight: BATCH, ..CrowdDesc::new(update) }
}

/// A crowd whose weights are set by the host.
struct Weighted<'a> {
    crowd: HeadlessCrowd<'a>,
    mesh: Arc<PackedMesh>,
    importance: Importance,
    /// The weights of its poses.
    posed: Vec<Vec<f32>>,
    fresh: CpuCrowd,
}

impl<'a> Weighted<'a> {
    fn new(headless: &'a Headless, mesh: &Arc<PackedMesh>, desc: CrowdDesc, begin: u64) -> Self {
        let mut crowd = HeadlessCrowd::new(headless, mesh, &desc).expect("a crowd");
        crowd.begin_at(begin);
        Self {
            crowd,
            mesh: mesh.clone(),
            importance: Importance::of_packed(mesh, &[]).expect("an order"),
            posed: vec![vec![]; desc.instances as usize],
            fresh: full_evaluations(mesh, desc.update),
        }
    }

    /// Hides, shows, cuts, removes or adds an instance, or requests other weights; says what.
    fn change(&mut self, rng: &mut Rng) -> Result<&'static str> {
        let crowd = &mut self.crowd;
        let instance = rng.below(crowd.crowd().desc().instances as usize) as u32;
        let shown = crowd.crowd().shown().any(|shown| shown == instance);
        let dice = rng.below(128);
        let Ok(before) = crowd.crowd().weights(instance) else {
            return crowd.add().map(|_| "instances added");
        };
        let mut weights = before.to_vec();
        match dice {
            0..2 => return crowd.remove(instance).map(|()| "instances removed"),
            2..6 => return crowd.set_hidden(instance, shown).map(|()| "instances hidden or shown"),
            6..10 => return crowd.reset_history(instance).map(|()| "cuts"),
            10..14 => weights.fill(0.0),
            14..24 => {
                weights.iter_mut().for_each(|weight| *weight = rng.range(-0.9, 1.8));
                self.importance.apply(rng.range(0.0, TARGETS as f32), &mut weights)?;
            }
            _ => (0..1 + rng.below(3)).for_each(|_| {
                let still = rng.below(2) == 0;
                weights[rng.below(TARGETS)] = if still { 0.0 } else { rng.range(-0.9, 1.8) };
            }),
        }
        crowd.set_weights(instance, &weights).map(|()| "weights set")
    }

    /// Runs a batch of frames, after a few that are lost if `lost` says so.
    fn run(&mut self, rng: &mut Rng, counts: &mut Counts, lost: bool) -> Result<()> {
        if lost {
            self.change(rng)?;
            let (_, first) = self.crowd.record(&[])?;
            self.change(rng)?;
            self.crowd.record(&[])?;
            self.crowd.discard(first.ticket)?;
        }
        let mut recorded = vec![];
        for _ in 0..BATCH {
            count(counts, self.change(rng)?);
            recorded.push(self.crowd.record(&[])?.0);
            for instance in self.crowd.crowd().shown() {
                self.posed[instance as usize] = self.crowd.crowd().weights(instance)?.to_vec();
            }
        }
        self.crowd.submit(recorded)
    }

    /// Compares poses, of hidden instances too, with full evaluations: bit for bit if fixed-point.
    fn compare(&mut self, counts: &mut Counts, digest: &mut DefaultHasher) {
        let CrowdDesc { instances, update, .. } = *self.crowd.crowd().desc();
        for instance in 0..instances {
            if self.crowd.crowd().pose(instance).is_err() {
                continue;
            }
            let pose = self.crowd.read_stored(instance, 0).expect("a pose");
            let weights = &self.posed[instance as usize];
            digest.write(&pose);
            if update.pose.has_integers() {
                count(counts, "poses of integers compared bit for bit");
                self.fresh.set_weights(0, weights).expect("weights");
                self.fresh.update();
                let same = pose == self.fresh.stored_pose(0, 0).expect("an instance");
                assert!(same, "{update:?}, instance {instance}: {weights:?}");
                continue;
            }
            count(counts, "float32 poses compared");
            let error = gpu::error(&mut self.crowd, instance, &self.mesh, weights);
            let kept = error.within(f64::from(update.tolerance), NORMAL);
            assert!(kept || is_kept(&error, self.mesh.layout().diagonal), "instance {instance}: {error:?}");
        }
    }
}

/// Plays clips, hides, shows, cuts, removes and adds instances of a crowd on the GPU, of which `gone` were removed.
fn change(scene: &mut Scene<'_>, gone: &mut Vec<u32>, rng: &mut Rng, second: f64) -> &'static str {
    let instance = rng.below(scene.instances().len()) as u32;
    if gone.contains(&instance) {
        let added = scene.add();
        gone.retain(|gone| *gone != added);
        return "instances added";
    }
    match rng.below(64) {
        0 => {
            scene.remove(instance);
            gone.push(instance);
            "instances removed"
        }
        1..4 => {
            scene.hide(instance, !scene.is_hidden(instance));
            "instances hidden or shown"
        }
        4..6 => {
            scene.reset_history(instance);
            "cuts"
        }
        6..8 => {
            scene.set_level(instance, rng.range(0.0, TARGETS as f32 + 1.0));
            "levels of detail changed"
        }
        8..16 => {
            let repeat = if rng.below(4) == 0 { Repeat::Once } else { Repeat::Loop };
            let (start, speed) = (second + f64::from(rng.range(-20.0, 5.0)), f64::from(rng.range(-2.0, 2.0)));
            scene.play(instance, Playback { start, speed, repeat, ..Playback::new(rng.below(3) as u32) });
            "clips begun"
        }
        _ => "frames of clips",
    }
}

fn count(counts: &mut Counts, what: &'static str) {
    *counts.entry(what).or_default() += 1;
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
    let kinds = [
        (packed(DeltaFormat::Fast), fixed(PoseFormat::Fixed32, 2)),
        (packed(DeltaFormat::Small), fixed(PoseFormat::Fixed16, 3)),
        (packed(DeltaFormat::Fast), UpdateDesc { tolerance: 1e-2, ..UpdateDesc::blocks() }),
    ];
    let weighted = |(mesh, update): &(Arc<PackedMesh>, UpdateDesc), rng: &mut Rng| {
        Weighted::new(headless, mesh, described(rng, *update), begin)
    };
    let mesh = &kinds[0].0;
    let clips: [_; 3] = std::array::from_fn(|clip| {
        let values = (0..8).flat_map(|frame| gpu::weights(mesh, frame, clip as u32)).collect();
        gpu::clip(mesh, 10.0 + clip as f32, values)
    });
    let importance = Importance::of_packed(mesh, &[]).expect("an order");
    let animation = AnimationDesc { importance: Some(&importance), ..AnimationDesc::new(&clips) };
    let animated = |rng: &mut Rng, second: f64| {
        let mut scene = Scene::new(headless, mesh, described(rng, fixed(PoseFormat::Fixed16, 2)), &animation);
        scene.begin_at(begin, second);
        (scene, vec![])
    };
    let mut crowds = kinds.each_ref().map(|kind| weighted(kind, &mut rng));
    let (started, first_second) = (Instant::now(), (CLOCK_WRAPS - f64::from(frames) / RATE / 2.0).max(0.0));
    let (mut scene, mut gone) = animated(&mut rng, first_second);
    let (mut counts, mut digest) = (Counts::new(), DefaultHasher::new());
    let batches = frames.div_ceil(BATCH);
    let (mut early, mut last) = ([0; 2], [0; 2]);
    println!("| frames | seconds | VmRSS, KiB | of the device, KiB |\n|---|---|---|---|");
    for batch in 0..batches {
        let second = |frame: u32| first_second + f64::from(batch * BATCH + frame) / RATE;
        for (crowd, kind) in crowds.iter_mut().zip(&kinds) {
            if rng.below(32) == 0 {
                count(&mut counts, "crowds dropped and made");
                *crowd = weighted(kind, &mut rng);
            }
            let lost = rng.below(16) == 0;
            crowd.run(&mut rng, &mut counts, lost).expect("a batch of frames");
        }
        if rng.below(32) == 0 {
            count(&mut counts, "animated crowds dropped and made");
            (scene, gone) = animated(&mut rng, second(0));
        }
        if rng.below(16) == 0 {
            scene.drop_one(second(0));
        }
        let recorded = (0..BATCH).map(|frame| {
            count(&mut counts, change(&mut scene, &mut gone, &mut rng, second(frame)));
            scene.record(second(frame))
        });
        let recorded = recorded.collect();
        scene.run(recorded);
        if batch % COMPARED == 0 || batch + 1 == batches {
            crowds.iter_mut().for_each(|crowd| crowd.compare(&mut counts, &mut digest));
            for instance in scene.instances().filter(|i| !scene.is_hidden(*i)).collect::<Vec<_>>() {
                count(&mut counts, "animated poses compared bit for bit");
                scene.assert_fresh(instance);
                digest.write(&scene.crowd.read_stored(instance, 0).expect("a pose"));
            }
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
