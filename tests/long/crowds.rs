//! The crowds of the long run: their events, and their expected poses.

use super::Counts;
use crate::prelude::*;
use crate::twin::AnimatedReference;
use deltamorph::internals::plan::instances::InstanceState;
use deltamorph::internals::update::animated::Playbacks;
use deltamorph::lod::Importance;
use deltamorph::{PoseView, Repeat, Result};
use std::hash::{DefaultHasher, Hasher};

const TARGETS: usize = 12;
/// Least (and initial) and most places of a crowd.
const PLACES: [u32; 2] = [2, 6];
/// One frame in this many replaces a crowd, with any number of places.
const MADE_ANEW: usize = 512;

/// Objects that the commands of a batch use, and the host no longer needs.
#[derive(Default)]
pub struct Loose {
    _crowds: Vec<Crowd>,
}

fn count(counts: &mut Counts, what: &'static str) {
    *counts.entry(what).or_default() += 1;
}

/// Returns, occasionally, the places of a crowd that replaces another.
fn places(rng: &mut Rng) -> Option<u32> {
    (rng.below(MADE_ANEW) == 0).then(|| PLACES[0] + rng.below((PLACES[1] - PLACES[0]) as usize + 1) as u32)
}

/// Counts an update of a crowd that began at `begin`.
fn crosses(begin: u64, updates: &mut u64, counts: &mut Counts) {
    *updates += 1;
    if begin + *updates == 1 << 32 {
        count(counts, "crowds whose number of updates crossed 32 bits");
    }
}

fn packed(format: DeltaFormat) -> Arc<PackedMesh> {
    let blocks = BlockDesc { size: Some(32), ..Default::default() };
    let mesh = PackedMesh::pack(&testing::mesh(96, TARGETS), &PackDesc { blocks, ..PackDesc::new(format) });
    Arc::new(mesh.expect("a mesh that packs"))
}

/// Makes a crowd for full evaluations on the CPU, one at a time.
fn evaluations(mesh: &Arc<PackedMesh>, update: UpdateDesc) -> CpuCrowd {
    let update = UpdateDesc { path: UpdatePath::Cpu, mode: UpdateMode::Rebuild, slots: 1, ..update };
    CpuCrowd::new(mesh.clone(), &CrowdDesc::new(update), 1).expect("a crowd")
}

fn stored<'a>(fresh: &'a mut CpuCrowd, weights: &[f32]) -> &'a [u8] {
    fresh.set_weights(0, weights).expect("weights");
    fresh.update();
    fresh.stored_pose(0, 0).expect("an instance")
}

fn range(view: PoseView) -> (vk::Buffer, u64, u64) {
    (view.buffer, view.offset, view.size)
}

/// A crowd whose weights are set by the host.
pub struct Weighted<'a> {
    headless: &'a Headless,
    pub crowd: Crowd,
    mesh: GpuMesh,
    source: Arc<PackedMesh>,
    importance: Importance,
    /// The weights of its poses.
    posed: Vec<Vec<f32>>,
    fresh: CpuCrowd,
    begin: u64,
    /// Number of updates since then that ran.
    updates: u64,
}

impl<'a> Weighted<'a> {
    pub fn new(headless: &'a Headless, format: DeltaFormat, update: UpdateDesc, begin: u64) -> Self {
        let source = packed(format);
        let mesh = gpu::upload(headless, headless.engine(), &source);
        let crowd = Self::crowd(headless, &mesh, update, PLACES[0], begin);
        let (posed, fresh) = (vec![vec![]; PLACES[1] as usize], evaluations(&source, update));
        let importance = Importance::of_packed(&source, &[]).expect("an order");
        Self { headless, crowd, mesh, importance, posed, fresh, begin, updates: 0, source }
    }

    fn crowd(headless: &Headless, mesh: &GpuMesh, update: UpdateDesc, places: u32, begin: u64) -> Crowd {
        let desc = CrowdDesc { instances: places, frames_in_flight: super::BATCH, ..CrowdDesc::new(update) };
        let mut crowd = headless.engine().create_crowd(mesh, &desc).expect("a crowd");
        crowd.begin_at(begin);
        crowd
    }

    /// Occasionally replaces this crowd with another.
    pub fn come_and_go(&mut self, rng: &mut Rng, counts: &mut Counts, loose: &mut Loose) {
        if let Some(places) = places(rng) {
            count(counts, "crowds dropped and made");
            let crowd = Self::crowd(self.headless, &self.mesh, self.crowd.desc().update, places, self.begin);
            loose._crowds.push(std::mem::replace(&mut self.crowd, crowd));
            self.updates = 0;
        }
    }

    /// Hides, shows, cuts, removes or adds an instance, or requests other weights.
    pub fn change(&mut self, rng: &mut Rng, counts: &mut Counts) -> Result<()> {
        let crowd = &mut self.crowd;
        let instance = rng.below(crowd.desc().instances as usize) as u32;
        let shown = crowd.shown().any(|shown| shown == instance);
        let dice = rng.below(128);
        let Ok(before) = crowd.weights(instance) else {
            if dice < 32 {
                count(counts, "instances added");
                crowd.add()?;
            }
            return Ok(());
        };
        let mut weights = before.to_vec();
        match dice {
            0..2 => return crowd.remove(instance).inspect(|()| count(counts, "instances removed")),
            2..6 => {
                count(counts, if shown { "instances hidden" } else { "instances shown" });
                return crowd.set_hidden(instance, shown);
            }
            6..10 => return crowd.reset_history(instance).inspect(|()| count(counts, "cuts")),
            10..14 => weights.fill(0.0),
            14..24 => {
                weights.iter_mut().for_each(|weight| *weight = rng.range(-0.9, 1.8));
                if dice > 18 {
                    count(counts, "levels of detail changed");
                    self.importance.apply(rng.range(0.0, TARGETS as f32), &mut weights)?;
                }
            }
            _ => (0..1 + rng.below(3)).for_each(|_| {
                let still = rng.below(2) == 0;
                weights[rng.below(TARGETS)] = if still { 0.0 } else { rng.range(-0.9, 1.8) };
            }),
        }
        crowd.set_weights(instance, &weights)
    }

    /// Notes that an update of the requested weights was recorded and will run.
    pub fn ran(&mut self, counts: &mut Counts) {
        crosses(self.begin, &mut self.updates, counts);
        for instance in self.crowd.shown() {
            let weights = self.crowd.weights(instance).expect("an instance that is shown");
            self.posed[instance as usize].clear();
            self.posed[instance as usize].extend_from_slice(weights);
        }
    }

    /// Compares poses, of hidden instances too, with full evaluations: bit for bit if fixed-point.
    pub fn compare(&mut self, counts: &mut Counts, digest: &mut DefaultHasher) {
        let crowd = &self.crowd;
        let (instances, views): (Vec<_>, Vec<_>) =
            (0..crowd.desc().instances).filter_map(|i| Some((i, range(crowd.pose(i).ok()?)))).unzip();
        let update = crowd.desc().update;
        for (instance, pose) in instances.into_iter().zip(self.headless.read(&views).expect("poses")) {
            let weights = &self.posed[instance as usize];
            digest.write(&pose);
            if update.pose.has_integers() {
                count(counts, "poses of integers compared bit for bit");
                assert!(pose == stored(&mut self.fresh, weights), "{update:?}, instance {instance}: {weights:?}");
                continue;
            }
            count(counts, "float32 poses compared");
            let numbers: Vec<f32> = pose.as_chunks().0.iter().map(|bytes| f32::from_ne_bytes(*bytes)).collect();
            let pose = self.source.layout().to_user_order(&numbers);
            let error = compare(&pose, &gpu::reference(&self.source, &update, weights));
            let kept = error.within(f64::from(update.tolerance), gpu::NORMAL);
            assert!(kept || gpu::is_kept(&error, self.source.layout().diagonal), "instance {instance}: {error:?}");
        }
    }
}

/// A crowd that plays clips on the GPU, and its twin.
pub struct Animated<'a> {
    headless: &'a Headless,
    pub crowd: Crowd,
    mesh: GpuMesh,
    source: Arc<PackedMesh>,
    clips: Vec<WeightClip>,
    importance: Importance,
    on_grid: Clips,
    grid: PoseGrid,
    heads: Playbacks,
    fresh: CpuCrowd,
    now: f64,
    begin: u64,
    updates: u64,
}

const CLIPS: usize = 3;

impl<'a> Animated<'a> {
    pub fn new(headless: &'a Headless, update: UpdateDesc, begin: u64) -> Self {
        let source = packed(DeltaFormat::Fast);
        let mesh = gpu::upload(headless, headless.engine(), &source);
        let clips: [_; CLIPS] = std::array::from_fn(|clip| {
            let values = (0..8).flat_map(|frame| gpu::weights(&source, frame, clip as u32)).collect();
            gpu::clip(&source, 10.0 + clip as f32, values)
        });
        let importance = Importance::of_packed(&source, &[]).expect("an order");
        let animation = AnimationDesc { importance: Some(&importance), ..AnimationDesc::new(&clips) };
        let grid = update.grid(source.layout()).expect("a grid").expect("poses of integers");
        let on_grid = Clips::new(&animation, source.layout(), grid).expect("clips");
        // SAFETY: `run` hands out a recording buffer of the engine's device, and waits.
        let crowd = headless.run(|cmd| unsafe {
            let desc = CrowdDesc { instances: PLACES[0], ..CrowdDesc::new(update) };
            headless.engine().create_animated_crowd(cmd, &mesh, &desc, &animation)
        });
        let (crowd, fresh) = (crowd.expect("a crowd"), evaluations(&source, update));
        let (clips, heads, now) = (clips.into(), Playbacks::new(PLACES[0]), 0.0);
        let mut this = Self {
            headless,
            crowd,
            mesh,
            clips,
            importance,
            on_grid,
            grid,
            heads,
            fresh,
            now,
            begin,
            updates: 0,
            source,
        };
        this.begin();
        this
    }

    /// Begins with a new crowd, which shows a pose and continues the counts.
    fn begin(&mut self) {
        self.updates = 0;
        self.crowd.begin_at(self.begin);
    }

    /// See [`Weighted::come_and_go`].
    pub fn come_and_go(
        &mut self,
        cmd: vk::CommandBuffer,
        rng: &mut Rng,
        counts: &mut Counts,
        loose: &mut Loose,
    ) -> Result<()> {
        if let Some(places) = places(rng) {
            count(counts, "animated crowds dropped and made");
            let animation = AnimationDesc { importance: Some(&self.importance), ..AnimationDesc::new(&self.clips) };
            let desc = CrowdDesc { instances: places, ..*self.crowd.desc() };
            // SAFETY: the buffer records on the engine's device and is waited for; the replaced crowd is kept until
            // then.
            let crowd = unsafe { self.headless.engine().create_animated_crowd(cmd, &self.mesh, &desc, &animation) }?;
            loose._crowds.push(std::mem::replace(&mut self.crowd, crowd));
            self.heads = Playbacks::new(places);
            self.begin();
        }
        Ok(())
    }

    /// See [`Weighted::change`]; also changes clips, up to a time.
    pub fn change(&mut self, rng: &mut Rng, counts: &mut Counts, second: f64) -> Result<()> {
        self.now = second;
        self.crowd.set_time(second)?;
        self.heads.set_time(second)?;
        let (crowd, heads, clips) = (&mut self.crowd, &mut self.heads, &self.on_grid);
        let instance = rng.below(crowd.desc().instances as usize) as u32;
        let shown = crowd.shown().any(|shown| shown == instance);
        match rng.below(64) {
            0 if crowd.remove(instance).is_ok() => {
                count(counts, "instances removed");
                heads.set_hidden(instance, true);
            }
            1..8 => {
                if let Ok(instance) = crowd.add() {
                    count(counts, "instances added");
                    heads.add(instance);
                }
            }
            8..10 if crowd.set_hidden(instance, shown).is_ok() => {
                count(counts, if shown { "instances hidden" } else { "instances shown" });
                heads.set_hidden(instance, shown);
            }
            10..12 if crowd.reset_history(instance).is_ok() => {
                count(counts, "cuts");
                heads.reset_history(instance);
            }
            12..14 => {
                let level = rng.range(0.0, TARGETS as f32 + 1.0);
                if crowd.set_level(instance, level).is_ok() {
                    count(counts, "levels of detail changed");
                    heads.set_level(instance, level, clips)?;
                }
            }
            14..22 => {
                let repeat = if rng.below(4) == 0 { Repeat::Once } else { Repeat::Loop };
                let (start, speed) = (second + f64::from(rng.range(-20.0, 5.0)), f64::from(rng.range(-2.0, 2.0)));
                let playback = Playback { start, speed, repeat, ..Playback::new(rng.below(CLIPS) as u32) };
                if crowd.play(instance, &playback).is_ok() {
                    count(counts, "clips begun");
                    heads.play(instance, &playback, clips)?;
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Notes that an update was recorded and will run.
    pub fn ran(&mut self, counts: &mut Counts) {
        crosses(self.begin, &mut self.updates, counts);
        self.heads.update(&self.on_grid);
    }

    /// Releases staging memory after the recorded commands have run.
    pub fn release(&mut self) {
        self.crowd.release_staging();
    }

    /// Compares poses with full evaluations of the weights that the CPU samples, bit for bit.
    pub fn compare(&mut self, counts: &mut Counts, digest: &mut DefaultHasher) {
        let Self { headless, crowd, source, heads, .. } = self;
        let shown: Vec<u32> = crowd.shown().collect();
        let mut twin =
            AnimatedReference::new(crowd.desc().update, source.layout(), crowd.desc().instances).expect("a twin");
        twin.update(&self.on_grid, heads, 0);
        let views: Vec<_> = shown.iter().map(|&i| range(crowd.pose(i).expect("a pose"))).collect();
        for (instance, pose) in shown.into_iter().zip(headless.read(&views).expect("poses")) {
            let steps = twin.weights(instance as usize).iter();
            let weights: Vec<f32> = steps.map(|&steps| steps as f32 * self.grid.weight_step()).collect();
            digest.write(&pose);
            count(counts, "animated poses compared bit for bit");
            let same = pose == stored(&mut self.fresh, &weights);
            assert!(same, "instance {instance} at second {}: {weights:?}", self.now);
        }
    }
}
