//! Levels of detail that the GPU chooses from the camera.

use crate::gpu::on_every_device;
use crate::scene::{self, Scene};
use deltamorph::lod::{Camera, Importance, Level, LevelDesc, Place};
use deltamorph::{AnimationDesc, DeltaFormat, Playback};
use deltamorph_headless::HeadlessCrowd;
use glam::{Mat4, Vec3};

/// The GPU chooses levels from the camera and the places of instances: goals equal those of the CPU, levels up to
/// float32 rounding and steps of 2⁻¹⁶; the resulting weights, plans and poses equal the reference bit for bit.
#[test]
fn levels_follow_the_camera_on_the_gpu() {
    on_every_device(|headless, _| {
        for (format, pose, budget) in
            [(DeltaFormat::Fast, scene::FIXED[0], 0.0), (DeltaFormat::Small, scene::FIXED[1], 0.02)]
        {
            let mesh = scene::packed(format, 64);
            let importance = Importance::of_packed(&mesh, &["eyeBlink"]).expect("an order");
            let (clips, targets) = (scene::clips(), importance.target_count());
            let update = scene::fixed(pose, 2).error_budget(budget * mesh.layout().diagonal);
            let desc = LevelDesc::default().pixels(2.0).fade(1.0);
            let animation = AnimationDesc::new(&clips).importance(Some(&importance)).level(Some(desc));
            let [mut whole, mut kept] =
                [(); 2].map(|()| Scene::new(headless, &mesh, scene::crowd(9, update), &animation));
            for head in 0..9 {
                let playback = Playback::new(head % 2).start(-0.3 * f64::from(head));
                [&mut whole, &mut kept].into_iter().for_each(|scene| scene.play(head, playback));
            }
            // A row of instances, each half as far again and half as large again as the one before; the last has no
            // place.
            let diagonal = mesh.layout().diagonal;
            let ball = Place { centre: Vec3::new(0.1, 0.2, 0.0) * diagonal, radius: 0.5 * diagonal, scale: 1.0 };
            let mut places: Vec<Place> = (0..8)
                .map(|head| {
                    let far = Mat4::from_translation(Vec3::Z * -diagonal * 1.5f32.powi(head));
                    ball.moved(&(far * Mat4::from_scale(Vec3::splat(1.0 + head as f32 / 4.0))))
                })
                .collect();
            places.iter().zip(0..).for_each(|(place, head)| kept.set_place(head, place));
            // A limit on the targets, however near.
            kept.set_level(1, 4.5);
            let mut levels = vec![Level::new(desc); 8];
            let steps = f64::from(mesh.layout().blocks.as_ref().expect("blocks").steps()[0])
                * f64::from(scene::grid(&mesh, &update).weight_step());
            let (mut fades, mut commands) = (0, vec![]);
            let all = |kept: &mut Scene<'_>, head| kept.followed(head).expect("a place").0 == (targets as u32) << 16;
            kept.step(0.0);
            assert!((0..8).all(|head| all(&mut kept, head)), "without a camera all are kept");
            whole.step(0.0);
            levels.iter_mut().for_each(|level| _ = level.step(&importance, f32::INFINITY, None));
            for frame in 1..16u32 {
                let far = [0.5, 2.0, 8.0, 30.0, 120.0, 500.0, 500.0, 120.0, 30.0, 8.0, 2.0, 0.5, 0.5, 0.5, 0.5]
                    [frame as usize - 1];
                let now = f64::from(frame) / 10.0;
                let camera = Camera { eye: Vec3::new(0.3, -0.1, far) * diagonal, height: 300.0, angle: 0.6 };
                kept.set_camera(&camera);
                match frame {
                    5 => {
                        kept.cut(2);
                        levels[2].cut();
                    }
                    6 | 9 => {
                        kept.hide(3, frame == 6);
                        levels[3].cut();
                    }
                    8 => {
                        places[4] = places[4].moved(&Mat4::from_translation(Vec3::Z * -40.0 * diagonal));
                        kept.set_place(4, &places[4]);
                    }
                    11 => {
                        kept.crowd.cut_camera();
                        levels.iter_mut().for_each(Level::cut);
                    }
                    13 => kept.drop_one(now),
                    _ => {}
                }
                whole.step(now);
                commands.push((frame, kept.step(now).1.len()));
                for (head, level) in (0..8).zip(&mut levels) {
                    if kept.is_hidden(head) {
                        continue;
                    }
                    let (unit, what) =
                        (camera.pixels_per_unit(&places[head as usize]), format!("frame {frame}, head {head}"));
                    let expected = level.step(&importance, unit, None);
                    fades += u32::from(expected.fract() != 0.0);
                    let (steps_kept, goal, most) = kept.followed(head).expect("it has a place");
                    assert_eq!(goal as usize, level.goal(), "{what}");
                    let off = f64::from(steps_kept) / 65_536.0 - f64::from(expected);
                    assert!(off.abs() < 2e-3, "{what}: {off} more than {expected}");
                    if budget > 0.0 {
                        let its = f64::from(desc.error_budget(unit).min(update.error_budget)) / steps;
                        assert!((most as f64 - its).abs() <= 2.0 + 1e-5 * its, "{what}: {most}, not {its}");
                        continue;
                    }
                    let [all, some] = [&mut whole, &mut kept].map(|s| s.crowd.read_weights(head).expect("weights"));
                    let expected = if head == 1 { expected.min(4.5) } else { expected };
                    for (t, (all, some)) in all.iter().zip(&some).enumerate() {
                        let expected = f64::from(*all) * f64::from(importance.factor(t, expected));
                        let off = (f64::from(*some) - expected).abs();
                        assert!(off <= 0.5 + f64::from(all.abs()) * 2e-3, "{what}, target {t}: {some}, not {expected}");
                    }
                }
                let [all, some] = [&mut whole, &mut kept].map(|s| s.crowd.read_weights(8).expect("weights"));
                assert!(budget > 0.0 || all == some, "the one without a place keeps all");
                [0, 2, 4, 7, 8].into_iter().for_each(|head| kept.assert_fresh(head));
            }
            assert!(fades > 20, "{fades} levels between two targets");
            // A moving camera takes push constants only: records come with cuts, hiding and places.
            let (records, plain): (Vec<_>, Vec<_>) =
                commands.into_iter().partition(|(frame, _)| [5, 6, 8, 9].contains(frame));
            assert!(plain.iter().all(|(_, count)| *count == plain[0].1), "{plain:?}");
            assert!(records.iter().all(|(_, count)| *count > plain[0].1), "{records:?}");
        }
    });
}

/// Invalid cameras and places are refused, with a remedy.
#[test]
fn cameras_and_places_that_cannot_be_are_refused() {
    on_every_device(|headless, _| {
        let (mesh, clips) = (scene::packed(DeltaFormat::Fast, 64), scene::clips());
        let importance = Importance::of_packed(&mesh, &[]).expect("an order");
        let desc = scene::crowd(1, scene::fixed(scene::FIXED[0], 2));
        let animation = AnimationDesc::new(&clips).level(Some(LevelDesc::default()));
        deltamorph::testing::says(
            HeadlessCrowd::animated(headless, &mesh, &desc, &animation),
            &["without an order of importance"],
        );
        let animation = AnimationDesc::new(&clips).importance(Some(&importance));
        let camera = Camera { eye: Vec3::ZERO, height: 100.0, angle: 0.5 };
        let place = Place::around(&[Vec3::X, Vec3::Y]);
        let refusals = |crowd: &mut HeadlessCrowd<'_, _>, cameras: &[Camera], places: &[Place], expected: &str| {
            let cameras = cameras.iter().map(|camera| crowd.set_camera(camera)).collect::<Vec<_>>();
            let all = cameras.into_iter().chain(places.iter().map(|place| crowd.set_place(0, place)));
            all.for_each(|result| deltamorph::testing::says(result, &[expected]));
        };
        let mut without = HeadlessCrowd::animated(headless, &mesh, &desc, &animation).expect("a crowd");
        refusals(&mut without, &[camera], &[place], "give AnimationDesc::level");
        let mut crowd = HeadlessCrowd::animated(headless, &mesh, &desc, &animation.level(Some(LevelDesc::default())))
            .expect("a crowd");
        let cameras = [
            Camera { eye: Vec3::NAN, ..camera },
            Camera { height: 0.0, ..camera },
            Camera { height: f32::INFINITY, ..camera },
            Camera { angle: 0.0, ..camera },
            Camera { angle: 3.2, ..camera },
        ];
        refusals(&mut crowd, &cameras, &[], "a camera at");
        let places = [
            Place { centre: Vec3::INFINITY, ..place },
            Place { radius: -1.0, ..place },
            Place { scale: 0.0, ..place },
            Place { scale: f32::NAN, ..place },
        ];
        refusals(&mut crowd, &[], &places, "an instance at");
        assert!(crowd.set_place(1, &place).is_err(), "there is one instance");
        crowd.set_place(0, &place).expect("a place");
        crowd.set_camera(&camera).expect("a camera");
    });
}
