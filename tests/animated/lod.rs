//! Levels of detail on every path: poses with dropped and faded targets equal the float64 reference of the remaining
//! weights.

use crate::gpu::{self, NORMAL, POSITION, on_every_device};
use crate::scene::{self, Scene};
use crate::testing;
use deltamorph::lod::{Importance, Level, LevelDesc};
use deltamorph::reference::{compare, evaluate, evaluate_unpacked};
use deltamorph::{
    AnimationDesc, BatchSize, CpuCrowd, CrowdDesc, DeltaFormat, MorphEngine, PackDesc, PackedMesh, Playback,
    UpdateDesc, UpdateMode, UpdatePath,
};
use deltamorph_headless::HeadlessCrowd;
use std::sync::Arc;

const TARGETS: usize = 12;

/// Returns an update of each path and each kind of pose.
fn paths(engine: &MorphEngine) -> Vec<(DeltaFormat, UpdateDesc)> {
    let [fixed32, fixed16, rebuilt16] = gpu::fixed();
    let compute = UpdateDesc::new(UpdatePath::Compute, BatchSize::Targets(4));
    let mut list = vec![
        (DeltaFormat::Small, UpdateDesc::blocks()),
        (DeltaFormat::Fast, fixed32),
        (DeltaFormat::Fast, fixed16.slots(3)),
        (DeltaFormat::Small, rebuilt16),
        (DeltaFormat::Small, UpdateDesc::blocks().mode(UpdateMode::Rebuild)),
        (DeltaFormat::Float32, compute),
    ];
    if engine.caps().transform_feedback.is_some() {
        list.push((DeltaFormat::Snorm16, UpdateDesc::new(UpdatePath::Feedback, BatchSize::Targets(4))));
    }
    list
}

/// Returns the weights of a frame, as from an animation.
fn weights(frame: usize) -> Vec<f32> {
    (0..TARGETS).map(|t| ((t * 13 + frame * 5) % 17) as f32 / 16.0 - 0.4).collect()
}

/// Moves away and back, and rests for a while: pixels per unit.
const CAMERA: [f32; 10] = [30.0, 8.0, 2.0, 0.5, 0.1, 0.1, 0.4, 3.0, 10.0, 30.0];

fn level() -> Level {
    // Wide fades, so that they take only a few frames.
    Level::new(LevelDesc::default().pixels(8.0).fade(6.0))
}

#[test]
fn what_is_kept_is_applied_on_every_path() {
    on_every_device(|headless, engine| {
        let mesh = testing::mesh(700, TARGETS);
        let importance = Importance::of(&mesh, &[]).expect("an order");
        for (format, desc) in paths(engine) {
            let packed = gpu::packed(engine, &mesh, format);
            let mut crowd = HeadlessCrowd::new(headless, &packed, &CrowdDesc::new(desc)).expect("a crowd");
            let (mut level, mut levels) = (level(), vec![]);
            for (frame, pixels_per_unit) in CAMERA.into_iter().enumerate() {
                let whole = weights(frame);
                let mut kept = whole.clone();
                levels.push(level.step(&importance, pixels_per_unit, Some(&whole)));
                importance.apply(levels[frame], &mut kept).expect("as many weights");
                crowd.step(&[&kept]).expect("a step");
                // Computed target by target from the level, not by `apply`.
                let expected: Vec<f32> = (0..TARGETS).map(|t| whole[t] * importance.factor(t, levels[frame])).collect();
                let error = compare(&crowd.read_pose(0).expect("a pose"), &gpu::reference(&packed, &desc, &expected));
                let bound = POSITION * f64::from(packed.layout().diagonal);
                assert!(error.within(bound, NORMAL), "{desc:?} frame {frame} at {}: {error:?}", levels[frame]);
            }
            let parts = levels.iter().filter(|level| level.fract() != 0.0).count();
            let [fewest, most] = [f32::min, f32::max].map(|f| levels.iter().copied().reduce(f).expect("levels"));
            assert!(parts > 2 && fewest < 3.0 && most > 10.0, "{levels:?}");
        }
    });
}

/// On the path `cpu`, in every format; also bounds the distance from the pose of all weights.
#[test]
fn poses_on_the_cpu_are_off_by_no_more_than_the_pixels() {
    let mesh = testing::mesh(700, TARGETS);
    for format in DeltaFormat::ALL {
        let packed = Arc::new(PackedMesh::pack(&mesh, &PackDesc::new(format)).expect("a mesh that packs"));
        let importance = Importance::of_packed(&packed, &[]).expect("an order");
        let update = UpdateDesc::new(UpdatePath::Cpu, BatchSize::All);
        let mut crowd = CpuCrowd::new(packed.clone(), update, 1, 1).expect("a crowd");
        let mut level = level();
        for (frame, pixels_per_unit) in CAMERA.into_iter().enumerate() {
            let whole = weights(frame);
            let mut kept = whole.clone();
            level.cut();
            let at = level.step(&importance, pixels_per_unit, Some(&whole));
            importance.apply(at, &mut kept).expect("as many weights");
            crowd.set_weights(0, &kept).expect("weights");
            crowd.update();
            let pose = packed.layout().to_user_order(&crowd.pose(0).expect("a pose"));
            let rounding = 1e-3 * f64::from(mesh.diagonal);
            let off = compare(&pose, &evaluate_unpacked(&mesh, &whole)).position;
            assert!(off * f64::from(pixels_per_unit) <= 4.0 + rounding, "{format:?} frame {frame}: {off}");
            // Dropping targets has a visible effect.
            assert!(at >= 11.0 || off > rounding, "{format:?} frame {frame}: {off}, {at} kept");
        }
    }
}

/// Dropping a target is one more delta weight; a dropped target costs nothing, nor does a camera that rests or
/// trembles.
#[test]
fn a_target_that_is_dropped_is_a_delta_weight() {
    let mesh = testing::mesh(700, TARGETS);
    let packed = Arc::new(PackedMesh::pack(&mesh, &PackDesc::new(DeltaFormat::Fast)).expect("a mesh that packs"));
    let importance = Importance::of_packed(&packed, &[]).expect("an order");
    let update = UpdateDesc::new(UpdatePath::Cpu, BatchSize::All);
    let mut crowd = CpuCrowd::new(packed.clone(), update, 1, 1).expect("a crowd");
    let mut coefficients = |level: f32, weights: &[f32]| {
        let mut kept = weights.to_vec();
        importance.apply(level, &mut kept).expect("as many weights");
        crowd.set_weights(0, &kept).expect("weights");
        let stats = crowd.update();
        (stats.coefficients, stats.bytes_moved)
    };
    let mut whole = vec![0.5; TARGETS];
    assert_eq!(coefficients(12.0, &whole).0, 12);
    assert_eq!(coefficients(8.0, &whole).0, 4);
    assert_eq!(coefficients(7.75, &whole).0, 1);
    assert_eq!(coefficients(7.75, &whole), (0, 0));
    // All weights change; those of dropped targets have no effect.
    whole.fill(0.6);
    assert_eq!(coefficients(7.0, &whole).0, 8);
    whole.fill(0.7);
    assert_eq!(coefficients(7.0, &whole).0, 7);

    let mut level = level();
    let still: Vec<_> = [2.0, 2.1, 1.9, 2.05, 2.0, 1.95, 2.0]
        .into_iter()
        .map(|pixels| coefficients(level.step(&importance, pixels, Some(&whole)), &whole))
        .collect();
    assert!(still[2..].iter().all(|did| *did == (0, 0)), "{still:?}");
}

/// The same pixel tolerance gives each instance its own error budget: deferred changes stay within the current budget,
/// and are applied when it shrinks.
#[test]
fn one_number_of_pixels_steers_the_error_budget_too() {
    let mesh = testing::mesh(700, TARGETS);
    let packed = Arc::new(PackedMesh::pack(&mesh, &PackDesc::new(DeltaFormat::Small)).expect("a mesh that packs"));
    let desc = LevelDesc::default().pixels(1.0);
    let update = UpdateDesc::new(UpdatePath::Cpu, BatchSize::All).error_budget(10.0);
    let mut crowd = CpuCrowd::new(packed.clone(), update, 2, 1).expect("a crowd");
    let mut written = [0; 2];
    for frame in 0..60 {
        // Away and back; the other instance stays in place, and defers nothing.
        let pixels_per_unit = [2.0, 0.5, 0.1, 0.5, 2.0, 20.0][frame / 10];
        let budgets = [desc.error_budget(pixels_per_unit), 0.0];
        let whole: Vec<f32> = (0..TARGETS).map(|t| 0.02 * ((frame * (t + 1)) % 9) as f32 + 0.3).collect();
        for (head, budget) in (0..).zip(budgets) {
            crowd.set_error_budget(head, budget).expect("less than the crowd's");
            crowd.set_weights(head, &whole).expect("weights");
        }
        crowd.update();
        for (head, budget) in budgets.into_iter().enumerate() {
            written[head] += crowd.changed(head as u32).len();
            let pose = packed.layout().to_user_order(&crowd.pose(head as u32).expect("a pose"));
            let off = compare(&pose, &evaluate(&packed, &whole)).position;
            let most = f64::from(budget) + 1e-5 * f64::from(mesh.diagonal);
            assert!(off <= most, "frame {frame}, head {head}: {off}, {budget} allowed");
        }
    }
    assert!(written[0] * 3 < written[1] * 2, "{written:?}");
    let refused = crowd.set_error_budget(0, 11.0).expect_err("more than the crowd's").to_string();
    assert!(refused.contains("an error budget of 11 for an instance of a crowd that was made with 10"), "{refused}");
    on_every_device(|headless, engine| {
        let budget = UpdateDesc::blocks().error_budget(10.0);
        for (update, refused) in [(budget, 1), (UpdateDesc::new(UpdatePath::Compute, BatchSize::All), 2)] {
            let format = if refused == 1 { DeltaFormat::Small } else { DeltaFormat::Float32 };
            let packed = gpu::packed(engine, &mesh, format);
            // SAFETY: `run` hands out a recording buffer of the engine's device, and waits for it.
            let uploaded = headless.run(|cmd| unsafe { engine.upload(cmd, &packed) }).expect("an upload");
            let mut crowd = engine.create_crowd(&uploaded, &CrowdDesc::new(update)).expect("a crowd");
            let results = [crowd.set_error_budget(0, 1.0), crowd.set_error_budget(0, -1.0)];
            assert_eq!(results.iter().filter(|result| result.is_err()).count(), refused);
            assert!(crowd.set_error_budget(1, 1.0).is_err(), "there is one instance");
        }
    });
}

/// Crowds animated on the GPU: weights and plans equal the CPU reference bit for bit, and weights are those of clips
/// times the factors of each instance's level. The commands are the same except for the records that carry levels.
#[test]
fn levels_are_applied_on_the_gpu() {
    on_every_device(|headless, _| {
        for (format, pose) in [(DeltaFormat::Fast, scene::FIXED[0]), (DeltaFormat::Small, scene::FIXED[1])] {
            let mesh = scene::packed(format, 64);
            let importance = Importance::of_packed(&mesh, &[]).expect("an order");
            let (clips, targets) = (scene::clips(), importance.target_count());
            let update = scene::fixed(pose, 2);
            let step = f64::from(scene::grid(&mesh, &update).weight_step());
            let animation = AnimationDesc::new(&clips).importance(Some(&importance));
            let [mut whole, mut kept] =
                [(); 2].map(|()| Scene::new(headless, &mesh, scene::crowd(9, update), &animation));
            for head in 0..9 {
                let playback = Playback::new(head % 2).start(-0.3 * f64::from(head));
                [&mut whole, &mut kept].into_iter().for_each(|scene| scene.play(head, playback));
            }
            let unit = 1.0 / mesh.layout().diagonal;
            let desc = LevelDesc::default().pixels(2.0).fade(1.0);
            let mut levels = vec![Level::new(desc); 9];
            let mut elements = vec![];
            for frame in 0..12u32 {
                // Away, back, and at rest; the last instance stays in place.
                let pixels =
                    [900.0, 300.0, 60.0, 10.0, 1.0, 1.0, 5.0, 30.0, 200.0, 900.0, 900.0, 900.0][frame as usize];
                let now = f64::from(frame) / 10.0;
                let mut at = vec![];
                // The camera cuts to the last instance.
                levels.iter_mut().filter(|_| frame == 11).for_each(Level::cut);
                for (head, level) in (0..9).zip(&mut levels) {
                    let pixels = if head == 8 { f32::INFINITY } else { pixels * (1.0 + head as f32 / 4.0) };
                    at.push(level.step(&importance, pixels * unit, None));
                    kept.set_level(head, at[head as usize]);
                }
                if frame == 3 {
                    kept.drop_one(now);
                }
                whole.step(now);
                let (plan, _) = kept.step(now);
                elements.push(plan.values().map(|work| work.3.len()).sum::<usize>());
                for head in 0..9 {
                    let [all, some] = [&mut whole, &mut kept].map(|s| s.crowd.read_weights(head).expect("weights"));
                    for (t, (all, some)) in all.iter().zip(&some).enumerate() {
                        let factor = f64::from(importance.factor(t, at[head as usize]));
                        let expected = f64::from(*all) * factor;
                        // Levels and weights are rounded to different steps.
                        let most = 0.5 + f64::from(all.abs()) * 0.6 / 65_536.0;
                        let off = (f64::from(*some) - expected).abs();
                        assert!(off <= most, "frame {frame}, head {head}, target {t}: {some}, not {expected} ({step})");
                    }
                }
                [0, 4, 8].into_iter().for_each(|head| kept.assert_fresh(head));
            }
            assert!(levels[8].level() == Some(targets as f32), "{levels:?}");
            assert!(elements[5] * 3 < elements[1] && elements[11] > 3 * elements[5], "{elements:?}");
            // An idle crowd uploads nothing: the clock goes on, with the same commands.
            let [first, second] = [2.0, 2.1].map(|now| {
                (0..9).for_each(|head| kept.set_level(head, 4.5));
                kept.step(now).1
            });
            assert_eq!(first.len(), second.len() + 3, "records are brought once");
            testing::says(kept.crowd.set_level(0, f32::NAN), &["a level of NaN targets"]);
        }
        let (mesh, clips) = (scene::packed(DeltaFormat::Fast, 64), scene::clips());
        let desc = scene::crowd(1, scene::fixed(scene::FIXED[0], 2));
        let mut without = Scene::new(headless, &mesh, desc, &AnimationDesc::new(&clips));
        testing::says(without.crowd.set_level(0, 3.0), &["give AnimationDesc::importance"]);
        let other = Importance::of(&testing::mesh(100, 5), &[]).expect("an order");
        let animation = AnimationDesc::new(&clips).importance(Some(&other));
        testing::says(HeadlessCrowd::animated(headless, &mesh, &desc, &animation), &["of 5 targets for mesh"]);
    });
}
