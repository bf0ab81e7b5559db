//! The contact sheet of `lod`: frames with decreasing numbers of targets.

use super::gauge::Gauge;
use super::order::Order;
use super::shots::studio;
use crate::args::render::Background;
use crate::output::Failure;
use crate::render::canvas::{Align, Canvas};
use crate::render::scenery::Subject;
use crate::runner::Gpu;
use deltamorph::{BoundClip, MorphMesh};
use deltamorph_render::{Camera, Light, Poses, Scene, Show};
use glam::{Mat4, Vec3};
use std::path::Path;

/// Pixels of a cell, and of the line of text below it.
const CELL: u32 = 256;
const CAPTION: u32 = 30;
const TEXT: f32 = 17.0;
/// Frames on the sheet of one order.
const FRAMES: usize = 3;
const BACKGROUND: Background = Background(Some([0x23, 0x26, 0x2d]));
/// Shares of the targets kept, in quarters: a column each.
const QUARTERS: [usize; 4] = [4, 3, 2, 1];

/// Draws into the PNG `file` a row for each of the frames with the largest errors if `orders` keep half of the targets,
/// or for `frame` if given; with several orders, one such frame with a row for each order. The mesh was read at `path`.
pub fn draw(
    gpu: &Gpu,
    gauge: &Gauge<'_>,
    path: Option<&Path>,
    clips: &[BoundClip],
    orders: &[Order],
    frame: Option<usize>,
    file: &Path,
) -> Result<(), Failure> {
    let mesh = &gauge.input.kept;
    let names: Vec<&str> = mesh.targets.iter().map(|t| t.name.as_str()).collect();
    let frames: Vec<Vec<f32>> = clips.iter().flat_map(BoundClip::frames).collect();
    let shown = match frame {
        Some(frame) if frame < frames.len() => vec![frame],
        Some(frame) => {
            let text = format!("--frame {frame}: the clips have {} frames, counted from 0", frames.len());
            return Err(Failure::Usage(text));
        }
        None => worst(gauge, &frames, orders, &names, if orders.len() > 1 { 1 } else { FRAMES }),
    };
    let rows: Vec<(&Order, usize)> = shown.iter().flat_map(|f| orders.iter().map(move |order| (order, *f))).collect();

    let subject = Subject::of_mesh(path, mesh);
    let mut studio = studio(gpu, mesh, &subject.parts, [CELL; 2])?;
    let view = Camera::default().fit(moving(mesh).into_iter(), 1.0, 0.1);
    let scene = Scene { view, light: Light::default(), show: Show::Shaded };
    let size = [CELL * QUARTERS.len() as u32, (CELL + CAPTION) * rows.len() as u32];
    let mut sheet = Canvas::new(size, BACKGROUND);
    for (row, (order, frame)) in rows.into_iter().enumerate() {
        for (column, quarters) in QUARTERS.into_iter().enumerate() {
            let kept = (names.len() * quarters).div_ceil(4);
            let keeps = order.keeps(&names, kept);
            let weights: Vec<f32> =
                frames[frame].iter().zip(&keeps).map(|(w, kept)| if *kept { *w } else { 0.0 }).collect();
            studio.draw(Poses::Weights(&[&weights]), &[Mat4::IDENTITY], &scene, BACKGROUND.linear())?;
            let [left, top] = [column as u32 * CELL, row as u32 * (CELL + CAPTION)];
            let pictures = studio.finish()?;
            pictures.into_iter().for_each(|picture| sheet.put(&Canvas::from(picture), [left, top]));
            let text = match column {
                0 => format!("{}, frame {frame}: all {kept}", order.metric),
                _ => format!("{}%: {kept}", 25 * quarters),
            };
            let place = (left as f32 + CELL as f32 / 2.0, (top + CELL) as f32 + TEXT);
            sheet.text(&text, place, TEXT, BACKGROUND.ink(), Align::Middle, CELL as f32 - TEXT);
        }
    }
    sheet.save(file)
}

/// The `count` frames with the largest errors if `orders` keep half of the targets, the worst first. Of frames closer
/// than a twentieth of all, only the worst one.
fn worst(gauge: &Gauge<'_>, frames: &[Vec<f32>], orders: &[Order], names: &[&str], count: usize) -> Vec<usize> {
    let halves: Vec<Vec<bool>> = orders.iter().map(|order| order.keeps(names, names.len().div_ceil(2))).collect();
    let loss = |frame: &Vec<f32>| halves.iter().map(|keeps| gauge.vertices.of_frame(frame, keeps)).sum::<f64>();
    let losses: Vec<f64> = frames.iter().map(loss).collect();
    let mut chosen: Vec<usize> = vec![];
    while chosen.len() < count {
        let far = |frame: &usize| chosen.iter().all(|other| frame.abs_diff(*other) * 20 > frames.len());
        match (0..frames.len()).filter(far).max_by(|a, b| losses[*a].total_cmp(&losses[*b])) {
            Some(frame) => chosen.push(frame),
            None => break,
        }
    }
    chosen
}

/// The moving part of the face: vertices that a target moves by at least a tenth of the largest delta, in the base pose
/// and moved.
fn moving(mesh: &MorphMesh) -> Vec<Vec3> {
    let deltas = || mesh.targets.iter().flat_map(|target| target.vertices.iter().zip(&target.positions));
    let most = deltas().map(|(_, d)| d.length_squared()).fold(0.0, f32::max);
    let far = deltas().filter(|(_, d)| d.length_squared() >= 0.01 * most);
    far.flat_map(|(&v, d)| [mesh.positions[v as usize], mesh.positions[v as usize] + *d]).collect()
}
