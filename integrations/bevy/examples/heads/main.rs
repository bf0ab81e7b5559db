//! Heads in Bevy, morphed by Bevy and by deltamorph, one after the other, without a window.
//!
//!     cargo run --example heads -- [--heads N] [--vertices N] [--frames N] [--screenshot OUT.png]
//!
//! Prints the time of a frame of both and their ratio, and fails where the pictures differ by more than a few units in
//! 255.

mod scene;

use bevy::log::LogPlugin;
use bevy::prelude::Result;
use bevy::render::renderer::RenderAdapterInfo;
use bevy::render::settings::InstanceFlags;
use scene::{Scene, SceneDesc, difference};
use std::time::{Duration, Instant};

/// Pixels of an edge of the picture.
const EDGE: u32 = 512;
/// How much a channel may differ, and in how many pixels more: outlines and edges of shadows.
const ALLOWED: (u8, f64) = (4, 0.001);
/// Measurements of each, in turns; the shortest counts.
const ROUNDS: usize = 3;

fn main() -> Result {
    let mut arguments = std::env::args().skip(1);
    let (mut heads, mut vertices, mut frames, mut screenshot) = (1, None, 10, None);
    while let Some(argument) = arguments.next() {
        let value = arguments.next().ok_or_else(|| format!("{argument} takes a value"))?;
        let number = || value.parse::<usize>().map_err(|_| format!("{argument} {value}: give a whole number"));
        match argument.as_str() {
            "--heads" => heads = number()?.max(1),
            "--vertices" => vertices = Some(number()?.max(3)),
            "--frames" => frames = number()?.max(1),
            "--screenshot" => screenshot = Some(value),
            _ => return Err(format!("{argument}: use --heads, --vertices, --frames or --screenshot").into()),
        }
    }
    // One that Bevy's buffers have room for on software drivers, which bind 128 MiB; smaller ones for a crowd.
    let vertices = vertices.unwrap_or(if heads == 1 { 20_000 } else { 2_000 });
    let flags = InstanceFlags::empty();
    let desc = SceneDesc { heads, vertices, targets: 72, edge: EDGE, tangents: false, motion: false, flags };
    let mut scene = Scene::new(&desc, |app| _ = app.add_plugins(LogPlugin::default()))?;

    let mut pictures = [vec![], vec![]];
    let mut times = [Duration::MAX; 2];
    for round in 0..ROUNDS {
        for (who, is_bevys) in [(0, true), (1, false)] {
            scene.morph_by_bevy(is_bevys);
            times[who] = times[who].min(time(&mut scene, frames));
            if round == 0 {
                pictures[who] = scene.picture()?;
            }
        }
    }
    let [bevys, ours] = times.map(|time| 1e3 * time.as_secs_f64());
    println!(
        "{}: {heads} heads of {vertices} vertices and {} targets: Bevy {bevys:.2} ms, deltamorph {ours:.2} ms a \
         frame: {:.2} times",
        scene.app.world().resource::<RenderAdapterInfo>().name,
        desc.targets,
        bevys / ours,
    );
    if let Some(path) = screenshot {
        let mut png = png::Encoder::new(std::fs::File::create(path)?, EDGE, EDGE);
        png.set_color(png::ColorType::Rgba);
        png.write_header()?.write_image_data(&pictures[1])?;
    }
    let (largest, beyond) = difference(&pictures[0], &pictures[1], ALLOWED.0);
    println!(
        "pictures differ by {largest} of 255 at most, {:.4}% of the pixels by more than {}",
        100.0 * beyond,
        ALLOWED.0
    );
    if beyond > ALLOWED.1 {
        return Err("the pictures are not the same".into());
    }
    Ok(())
}

/// The time of a frame: the mean of `frames` frames of the clip.
fn time(scene: &mut Scene, frames: usize) -> Duration {
    scene.settle();
    let begin = Instant::now();
    for frame in 1..=frames {
        scene.show(frame);
        scene.app.update();
    }
    scene.wait();
    begin.elapsed() / frames as u32
}
