//! Levels of detail on every path: poses with dropped and faded targets equal the float64 reference of the remaining
//! weights.

use crate::prelude::*;
use crate::scene;
use crate::scene::Scene;
use deltamorph::lod::{Importance, Level};

const TARGETS: usize = 12;

/// The same pixel tolerance gives each instance its own error budget: deferred changes stay within the current budget,
/// and are applied when it shrinks.
#[test]
fn one_number_of_pixels_steers_the_error_budget_too() {
    let mesh = testing::mesh(700, TARGETS);
    let packed = Arc::new(PackedMesh::pack(&mesh, &PackDesc::new(DeltaFormat::Small)).expect("a mesh that packs"));
    let level = Level::new(1.0);
    let update = UpdateDesc { error_budget: 10.0, ..UpdateDesc::new(UpdatePath::Cpu, BatchSize::All) };
    let mut crowd = gpu::cpu_crowd(&packed, update, 2);
    let mut written = [0; 2];
    for frame in 0..60 {
        // Away and back; the other instance stays in place, and defers nothing.
        let pixels_per_unit = [2.0, 0.5, 0.1, 0.5, 2.0, 20.0][frame / 10];
        let budgets = [level.error_budget(pixels_per_unit), 0.0];
        let whole: Vec<f32> = (0..TARGETS).map(|t| 0.02 * ((frame * (t + 1)) % 9) as f32 + 0.3).collect();
        for (head, budget) in (0..).zip(budgets) {
            crowd.set_error_budget(head, budget).expect("less than the crowd's");
            crowd.set_weights(head, &whole).expect("weights");
        }
        crowd.update();
        for (head, budget) in budgets.into_iter().enumerate() {
            written[head] += crowd.changed(head as u32).iter().map(ExactSizeIterator::len).sum::<usize>();
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
        let budget = UpdateDesc { error_budget: 10.0, ..UpdateDesc::blocks() };
        for (update, refused) in [(budget, 1), (UpdateDesc::new(UpdatePath::Compute, BatchSize::All), 2)] {
            let format = if refused == 1 { DeltaFormat::Small } else { DeltaFormat::Float32 };
            let packed = gpu::packed(engine, &mesh, format);
            let uploaded = gpu::upload(headless, engine, &packed);
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
            let (clips, targets) = (scene::clips(), importance.order().len());
            let update = scene::fixed(pose, 2);
            let step = f64::from(scene::grid(&mesh, &update).weight_step());
            let animation = AnimationDesc { importance: Some(&importance), ..AnimationDesc::new(&clips) };
            let [mut whole, mut kept] =
                [(); 2].map(|()| Scene::new(headless, &mesh, scene::crowd(9, update), &animation));
            for head in 0..9 {
                let playback = Playback { start: -0.3 * f64::from(head), ..Playback::new(head % 2) };
                [&mut whole, &mut kept].into_iter().for_each(|scene| scene.play(head, playback));
            }
            let unit = 1.0 / mesh.layout().diagonal;
            let mut level = Level::new(2.0);
            level.fade = 1.0;
            let mut levels = vec![level; 9];
            let mut elements = vec![];
            for frame in 0..12u32 {
                // Away, back, and at rest; the last instance stays in place.
                let pixels =
                    [900.0, 300.0, 60.0, 10.0, 1.0, 1.0, 5.0, 30.0, 200.0, 900.0, 900.0, 900.0][frame as usize];
                let now = f64::from(frame) / 10.0;
                let mut at = vec![];
                // The camera cuts to the last instance.
                levels.iter_mut().filter(|_| frame == 11).for_each(Level::reset);
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
        let small = PackedMesh::pack(&testing::mesh(100, 5), &PackDesc::default()).expect("packed");
        let other = Importance::of_packed(&small, &[]).expect("an order");
        let animation = AnimationDesc { importance: Some(&other), ..AnimationDesc::new(&clips) };
        testing::says(HeadlessCrowd::animated(headless, &mesh, &desc, &animation), &["of 5 targets for mesh"]);
    });
}
