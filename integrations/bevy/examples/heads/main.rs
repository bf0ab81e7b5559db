//! Heads in Bevy, morphed by Bevy, by deltamorph, and not at all, in turn, without a window.
//!
//!     cargo run --example heads -- [--heads N] [--vertices N] [--mesh FOLDER] [--edge PIXELS] [--frames N]
//!                                  [--rounds N] [--normal-error DEGREES] [--screenshot OUT.png] [--window]
//!
//! Prints the frame times and the share of morphing (a frame minus the same frame without targets), and fails if the
//! pictures differ by more than a few units in 255. `--normal-error` is the largest angle by which packing may turn a
//! normal, for each target (0.5): errors of targets add up, and Bevy packs nothing. `--window` shows them in a window
//! instead: key M switches the morphing, and the title shows the frame times of both.

mod scene;
mod window;

use bevy::log::LogPlugin;
use bevy::prelude::Result;
use bevy::render::renderer::RenderAdapterInfo;
use bevy::render::settings::InstanceFlags;
use deltamorph_bevy::DeltamorphSettings;
use deltamorph_bevy::deltamorph::Tolerance;
use deltamorph_bevy::deltamorph::import::{self, ImportDesc, ImportedMesh};
use scene::{Face, Scene, SceneDesc, difference};
use std::path::Path;
use std::time::Instant;

/// Allowed difference of a channel, and fraction of pixels that may exceed it: outlines and edges of shadows.
const ALLOWED: (u8, f64) = (2, 0.001);

/// Who morphs.
const WHO: [&str; 3] = ["Bevy", "deltamorph", "nobody"];

fn main() -> Result {
    let mut arguments = std::env::args().skip(1);
    let (mut heads, mut vertices, mut edge, mut frames, mut rounds) = (1, None, 512, 10, 5);
    let (mut mesh, mut screenshot, mut in_window) = (None, None, false);
    let mut normal_error = DeltamorphSettings::default().normal_error_degrees;
    while let Some(argument) = arguments.next() {
        if argument == "--window" {
            in_window = true;
            continue;
        }
        let value = arguments.next().ok_or_else(|| format!("{argument} takes a value"))?;
        let number = || value.parse::<usize>().map_err(|_| format!("{argument} {value}: give a whole number"));
        match argument.as_str() {
            "--heads" => heads = number()?.max(1),
            "--vertices" => vertices = Some(number()?.max(3)),
            // Rows are read back in multiples of 256 bytes.
            "--edge" => edge = number()?.clamp(64, 4096).next_multiple_of(64) as u32,
            "--mesh" => mesh = Some(value),
            "--frames" => frames = number()?.max(1),
            "--rounds" => rounds = number()?.max(1),
            "--normal-error" => {
                let degrees = value.parse().ok().filter(|degrees| *degrees > 0.0);
                normal_error = degrees.ok_or_else(|| format!("{argument} {value}: give degrees above 0"))?;
            }
            "--screenshot" => screenshot = Some(value),
            _ => return Err(format!("{argument}: see the first lines of examples/heads/main.rs").into()),
        }
    }
    let face = match &mesh {
        Some(path) => folder(Path::new(path))?,
        // Few enough vertices for Bevy's buffers on software drivers, which bind 128 MiB; fewer for a crowd.
        None => Face::head(vertices.unwrap_or(if heads == 1 { 20_000 } else { 2_000 }), 72, 1.0)?,
    };
    let (count, targets) = (face.morphs.vertex_count(), face.morphs.targets.len());
    let flags = InstanceFlags::empty();
    let desc = SceneDesc { heads, edge, tangents: false, motion: false, window: in_window, flags };
    let mut scene = Scene::new(&desc, &face, |app| _ = app.add_plugins(LogPlugin::default()))?;
    scene.app.world_mut().resource_mut::<DeltamorphSettings>().normal_error_degrees = normal_error;
    if in_window {
        return window::run(scene);
    }
    println!(
        "{}: heads: {heads}, of {count} vertices and {targets} targets",
        scene.app.world().resource::<RenderAdapterInfo>().name
    );

    let mut pictures = vec![];
    for who in 0..2 {
        choose(&mut scene, who);
        pictures.push(scene.picture()?);
    }
    if let Some(path) = screenshot {
        let mut png = png::Encoder::new(std::fs::File::create(path)?, edge, edge);
        png.set_color(png::ColorType::Rgba);
        png.write_header()?.write_image_data(&pictures[1])?;
    }
    let (largest, beyond) = difference(&pictures[0], &pictures[1], ALLOWED.0);
    println!(
        "pictures differ by {largest} of 255 at most, {:.4}% of the pixels by more than {}",
        100.0 * beyond,
        ALLOWED.0
    );

    let rows = rounds * frames + 1;
    let works = [
        ("its clip".to_owned(), face.clip.clone()),
        (format!("8 of {targets} change"), random(targets, 8, rows)),
        ("all change".to_owned(), random(targets, targets, rows)),
        ("none changes".to_owned(), random(targets, 0, rows)),
        // A smile that stays, or a character's sliders.
        ("28 active, none changes".to_owned(), vec![(0..targets).map(|k| if k < 28 { 0.3 } else { 0.0 }).collect()]),
    ];
    // Milliseconds of each round, by work and by who morphs.
    let mut times = vec![[const { vec![] }; WHO.len()]; works.len()];
    for round in 0..rounds {
        for who in 0..WHO.len() {
            choose(&mut scene, who);
            for ((_, clip), times) in works.iter().zip(&mut times) {
                scene.clip.clone_from(clip);
                times[who].push(time(&mut scene, round * frames, frames));
            }
        }
    }
    for ((name, _), times) in works.iter().zip(&times) {
        let [bevys, ours, none] = times.each_ref().map(|times| median(times));
        let morphing = [bevys - none, ours - none];
        // Noise decides the ratio if morphing takes next to nothing of a frame.
        let ratio = match morphing[1] > 0.01 * none {
            true => format!("{:.1} times as fast", morphing[0] / morphing[1]),
            false => "too little to compare".to_owned(),
        };
        println!(
            "{name}: a frame {bevys:.2} ms by Bevy, {ours:.2} by deltamorph ({:.2} times as fast), {none:.2} by nobody; \
             morphing {:.2} and {:.2} ms: {ratio}",
            bevys / ours,
            morphing[0],
            morphing[1],
        );
        for (who, times) in WHO.iter().zip(times) {
            println!("    {who}: {}", times.iter().map(|time| format!("{time:.2}")).collect::<Vec<_>>().join(" "));
        }
    }
    if beyond > ALLOWED.1 {
        let text = "the pictures are not the same: the errors of packing may be too large for these weights";
        return Err(format!("{text}, try --normal-error {}", normal_error / 10.0).into());
    }
    Ok(())
}

/// Reads a folder with a mesh, its targets and a clip, the last by name.
fn folder(path: &Path) -> Result<Face> {
    let found = import::open(path, &ImportDesc::default().split(true))?;
    let ImportedMesh::Source(source) = found.mesh else { return Err("a packed file has no attributes".into()) };
    let clip = found.clips.last().ok_or("no weights/*.csv")?;
    Face::new(source.to_mesh(Tolerance::default())?, &import::open_clip(clip, None)?)
}

fn choose(scene: &mut Scene, who: usize) {
    scene.morph_by_bevy(who == 0);
    scene.with_targets(who < 2);
    scene.settle();
}

/// Makes random rows of weights, all nonzero, of which `changing` change from each row to the next.
fn random(targets: usize, changing: usize, rows: usize) -> Vec<Vec<f32>> {
    let mut state = 1_u64;
    // A linear congruential generator (Knuth, MMIX), of which the upper bits are used.
    let mut unit = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1 << 24) as f32
    };
    let mut row: Vec<f32> = (0..targets).map(|_| 0.1 * (0.1 + unit())).collect();
    let mut next = |row: &mut Vec<f32>| {
        // Distinct ones, drawn without replacement.
        let mut left: Vec<usize> = (0..targets).collect();
        for _ in 0..changing.min(targets) {
            let target = left.swap_remove((unit() * left.len() as f32) as usize);
            row[target] = 0.1 * (0.1 + unit());
        }
    };
    (0..rows)
        .map(|_| {
            next(&mut row);
            row.clone()
        })
        .collect()
}

/// Returns milliseconds per frame: the mean of `frames` frames from `first` on.
fn time(scene: &mut Scene, first: usize, frames: usize) -> f64 {
    scene.show(first);
    scene.settle();
    let begin = Instant::now();
    for frame in first + 1..=first + frames {
        scene.show(frame);
        scene.app.update();
    }
    scene.wait();
    1e3 * begin.elapsed().as_secs_f64() / frames as f64
}

fn median(times: &[f64]) -> f64 {
    let mut times = times.to_vec();
    times.sort_by(f64::total_cmp);
    (times[(times.len() - 1) / 2] + times[times.len() / 2]) / 2.0
}
