//! What frames take, morphed by Bevy, by deltamorph, and by nobody, in turn.

use crate::TURN;
use crate::scene::{Face, Scene, SceneDesc, difference};
use bevy::log::LogPlugin;
use bevy::prelude::Result;
use bevy::render::renderer::RenderAdapterInfo;
use bevy::render::settings::InstanceFlags;
use deltamorph_bevy::DeltamorphSettings;
use deltamorph_bevy::deltamorph::Tolerance;
use deltamorph_bevy::deltamorph::import::{self, ImportedMesh};
use std::path::Path;
use std::sync::PoisonError;
use std::time::Instant;

/// Frames that a time is the mean of, and times of each work.
const FRAMES: usize = 10;
const ROUNDS: usize = 5;

/// Prints a line of JSON for each work, as `peers/run` takes them. `DELTAMORPH_FACE`: a folder with a mesh, its targets
/// and a clip; without it the built-in head. `DELTAMORPH_HEADS`: how many of them, 1 if it is not set.
#[test]
#[ignore = "it measures, and takes a minute"]
fn frames() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let heads = std::env::var("DELTAMORPH_HEADS").map_or(1, |text| text.parse().expect("a number of heads"));
    let (name, face) = match std::env::var_os("DELTAMORPH_FACE") {
        Some(folder) => (Path::new(&folder).file_name().expect("a name").to_owned(), read(Path::new(&folder))),
        // Few enough vertices for Bevy's buffers on software drivers, which bind 128 MiB; fewer for a crowd.
        None => ("head".into(), Face::head(if heads == 1 { 20_000 } else { 2_000 }, 72, 1.0)),
    };
    let face = face.expect("a face");
    // Small pictures, so that frames are mostly vertices.
    let desc = SceneDesc { heads, edge: 64, tangents: false, motion: false, flags: InstanceFlags::empty() };
    let mut scene = Scene::new(&desc, &face, |app| _ = app.add_plugins(LogPlugin::default())).expect("a scene");
    // Errors of targets add up, and Bevy packs nothing.
    scene.app.world_mut().resource_mut::<DeltamorphSettings>().normal_error_degrees = 0.02;

    // Where a clip begins it may be at rest.
    scene.show(face.clip.len() / 3);
    let [ours, bevys] = [false, true].map(|is_bevys| {
        scene.morph_by_bevy(is_bevys);
        scene.picture().expect("a picture")
    });
    let (off, beyond) = difference(&ours, &bevys, 2);

    let targets = face.morphs.targets.len();
    let works = [
        ("clip", face.clip),
        ("all", random(targets, ROUNDS * FRAMES + 1)),
        // A smile that stays, or a character's sliders.
        ("constant", vec![(0..targets).map(|k| if k < 28 { 0.3 } else { 0.0 }).collect()]),
    ];
    let mut times = [const { [const { vec![] }; 3] }; 3];
    for round in 0..ROUNDS {
        for who in 0..3 {
            scene.morph_by_bevy(who == 0);
            scene.with_targets(who < 2);
            scene.settle();
            for ((_, clip), times) in works.iter().zip(&mut times) {
                scene.clip.clone_from(clip);
                times[who].push(time(&mut scene, round * FRAMES));
            }
        }
    }
    let device = &scene.app.world().resource::<RenderAdapterInfo>().name;
    println!();
    for ((work, _), times) in works.iter().zip(times) {
        let [bevys, ours, without] = times.map(median);
        for (peer, ms) in [("Bevy 0.20.1", bevys), ("deltamorph in Bevy", ours)] {
            println!(
                "{{\"scene\":{name:?},\"peer\":{peer:?},\"device\":{device:?},\"work\":{work:?},\"ms\":{ms:.2},\
                 \"without\":{without:.2},\"check\":{{\"off\":{off},\"right\":{}}}}}",
                off <= 2
            );
        }
    }
    assert!(beyond <= 0.001, "{beyond} of the pixels differ by more than 2 of 255");
}

/// Reads a folder with a mesh, its targets and a clip, the last by name.
fn read(folder: &Path) -> Result<Face> {
    let found = import::open(folder)?;
    let ImportedMesh::Source(source) = found.mesh else { return Err("a packed file has no attributes".into()) };
    let clip = found.clips.last().ok_or("no weights/*.csv")?;
    Face::new(source.split()?.kept(Tolerance::default())?, &import::open_clip(clip, None)?)
}

/// Makes rows of random weights, all nonzero.
fn random(targets: usize, rows: usize) -> Vec<Vec<f32>> {
    let mut rng = deltamorph_head::Rng::new(1, 0);
    (0..rows).map(|_| (0..targets).map(|_| 0.1 * (0.1 + rng.unit())).collect()).collect()
}

/// Returns milliseconds per frame: the mean of [`FRAMES`] frames from `first` on.
fn time(scene: &mut Scene, first: usize) -> f64 {
    scene.show(first);
    scene.settle();
    let begin = Instant::now();
    for frame in first + 1..=first + FRAMES {
        scene.show(frame);
        scene.app.update();
    }
    scene.wait();
    1e3 * begin.elapsed().as_secs_f64() / FRAMES as f64
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times[ROUNDS / 2]
}
