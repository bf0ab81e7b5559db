//! A camera that moves away from a wall of heads and back, with and without levels of detail: changes of the pictures,
//! and bytes that updates move.

use deltamorph::lod::{Importance, Level, LevelDesc, pixels_per_unit};
use deltamorph::{
    BatchSize, CpuCrowd, DeltaFormat, PackDesc, PackedMesh, Result, Tolerance, UpdateDesc, UpdateMode, UpdatePath,
};
use deltamorph_head::{HeadDesc, head, head_clip};
use deltamorph_headless::Headless;
use deltamorph_render::{Camera, Light, Picture, Poses, Scene, Show, Studio, StudioDesc, View, parts};
use glam::{Mat4, Vec3};
use std::sync::Arc;

/// A camera flight.
#[derive(Clone, Copy, Debug)]
pub struct Fly {
    /// Heads horizontally and vertically.
    pub wall: [u32; 2],
    pub vertices: usize,
    /// Frames, out and back.
    pub frames: usize,
    /// Distance of the camera in the middle of the flight, relative to its start.
    pub farthest: f32,
    /// Pixels of a picture, and the supersampling in each direction, in addition to the renderer's four samples.
    pub size: [u32; 2],
    pub supersampling: u32,
    pub lod: LevelDesc,
    /// Draw pictures; otherwise only count bytes.
    pub draws: bool,
}

/// The measurements of a frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct Frame {
    /// Distance of the camera, relative to the distance at which the wall fills the picture.
    pub distance: f32,
    /// Height in pixels of the head in the middle.
    pub head_pixels: f32,
    /// Kept targets, mean over the heads.
    pub kept: f32,
    /// Largest position error of a vertex of any head from targets that are not kept, in pixels: above half of
    /// [`LevelDesc::pixels`] while the fade lags.
    pub behind: f32,
    /// Bytes that the update moves, with the level of detail and with all targets.
    pub bytes: [u64; 2],
    /// The largest change of a channel of a pixel, in units of 1/255, from using this frame's levels instead of those
    /// of the frame before; and from levels that reach their goals at once.
    pub pop: [f32; 2],
    /// The largest change, in units of 1/255, since the frame before, of the difference between pictures with and
    /// without levels of detail.
    pub drift: f32,
}

const BACKGROUND: [f32; 4] = [0.2, 0.2, 0.2, 1.0];

impl Fly {
    pub fn new() -> Self {
        Self {
            wall: [10, 10],
            vertices: 1500,
            frames: 160,
            farthest: 24.0,
            size: [320, 240],
            supersampling: 8,
            lod: LevelDesc::default(),
            draws: true,
        }
    }

    /// Runs the flight. Calls `tell` after each frame.
    pub fn run(&self, headless: &Headless, mut tell: impl FnMut(usize, &Frame)) -> Result<Vec<Frame>> {
        let desc = HeadDesc::default().vertices(self.vertices);
        let mesh = head(&desc).to_mesh(Tolerance::default())?;
        let packed = Arc::new(PackedMesh::pack(&mesh, &PackDesc::new(DeltaFormat::Fast))?);
        let clip = head_clip(&desc, 200, 60.0);
        let names: Vec<&str> = mesh.targets.iter().map(|target| target.name.as_str()).collect();
        let clip: Vec<Vec<f32>> = clip.bind(&names)?.frames().collect();
        let importance = Importance::of_packed(&packed, &[])?.over(&packed, clip.iter().cloned())?;
        let [wide, high] = self.wall;
        let heads = (wide * high) as usize;
        let (low, up) = mesh.positions.iter().fold((Vec3::MAX, Vec3::MIN), |(a, b), p| (a.min(*p), b.max(*p)));
        let extent = up - low;
        let places: Vec<Mat4> = (0..wide * high)
            .map(|i| {
                let (x, y) = ((i % wide) as f32 - (wide - 1) as f32 / 2.0, (i / wide) as f32 - (high - 1) as f32 / 2.0);
                Mat4::from_translation(Vec3::new(x * extent.x * 1.1, y * extent.y * 1.05, -0.2 * y * extent.z))
            })
            .collect();
        let all: Vec<Vec3> =
            places.iter().flat_map(|place| [low, up].map(|corner| place.transform_point3(corner))).collect();
        let camera = Camera::default();
        let middle = (low + up) / 2.0;
        let aspect = self.size[0] as f32 / self.size[1] as f32;
        let size = self.size.map(|pixels| pixels * self.supersampling);

        let cpu = UpdateDesc::new(UpdatePath::Cpu, BatchSize::All);
        let crowd = || CpuCrowd::new(packed.clone(), cpu, wide * high, 2);
        let mut crowds = [crowd()?, crowd()?];
        // Poses that depend only on their weights: no change in a picture is rounding.
        let update = UpdateDesc::new(UpdatePath::Blocks, BatchSize::All).mode(UpdateMode::Rebuild);
        let studio = StudioDesc { size, heads: heads as u32, in_flight: 1, update, afterglow: 0.0, cull: false };
        let mut studio = match self.draws {
            true => Some(Studio::new(headless, &mesh, &packed, &parts(&mesh, &[""; 0]), studio)?),
            false => None,
        };
        let mut levels = vec![Level::new(self.lod); heads];
        let mut before: Option<Vec<(f32, usize)>> = None;
        let (mut off_before, mut frames): (Option<Vec<f32>>, Vec<Frame>) = (None, vec![]);
        for frame in 0..self.frames {
            let way = (1.0 - (frame as f32 / (self.frames - 1) as f32 * std::f32::consts::TAU).cos()) / 2.0;
            let distance = self.farthest.powf(way);
            let view = camera.fit(all.iter().copied(), aspect, 1.0 - 1.0 / distance);
            let pixels = |place: &Mat4| {
                let away = (view.eye - place.transform_point3(middle)).dot(view.axes[2]);
                pixels_per_unit(self.size[1] as f32, camera.angle.to_radians(), away)
            };
            let whole: Vec<Vec<f32>> = (0..heads).map(|i| clip[(frame + i * 17) % clip.len()].clone()).collect();
            let step = |(level, (place, weights)): (&mut Level, (&Mat4, &Vec<f32>))| {
                let at = level.step(&importance, pixels(place), Some(weights));
                (at, level.goal())
            };
            let now: Vec<(f32, usize)> = levels.iter_mut().zip(places.iter().zip(&whole)).map(step).collect();
            let kept = |levels: &[f32]| -> Result<Vec<Vec<f32>>> {
                let mut kept = whole.clone();
                kept.iter_mut().zip(levels).try_for_each(|(weights, level)| importance.apply(*level, weights))?;
                Ok(kept)
            };
            let faded: Vec<f32> = now.iter().map(|(level, _)| *level).collect();
            let mut bytes = [0; 2];
            for ((crowd, weights), bytes) in crowds.iter_mut().zip([kept(&faded)?, whole.clone()]).zip(&mut bytes) {
                (0..).zip(&weights).try_for_each(|(i, weights)| crowd.set_weights(i, weights))?;
                *bytes = crowd.update().bytes_moved;
            }
            let mut did = Frame {
                distance,
                head_pixels: pixels(&places[heads / 2]) * extent.y,
                kept: faded.iter().sum::<f32>() / heads as f32,
                behind: faded
                    .iter()
                    .zip(&places)
                    .map(|(level, place)| importance.error_of_keeping(*level as usize) * pixels(place))
                    .fold(0.0, f32::max),
                bytes,
                ..Frame::default()
            };
            if let Some(studio) = &mut studio {
                let mut picture = |weights: &[Vec<f32>]| -> Result<Vec<f32>> {
                    let weights: Vec<&[f32]> = weights.iter().map(Vec::as_slice).collect();
                    let scene = scene(view);
                    studio.draw(Poses::Weights(&weights), &places, &scene, BACKGROUND)?;
                    let drawn = studio.finish()?;
                    Ok(drawn.last().map(|picture| shrunk(picture, self.supersampling)).unwrap_or_default())
                };
                let [lod, full] = [picture(&kept(&faded)?)?, picture(&whole)?];
                let off: Vec<f32> = lod.iter().zip(&full).map(|(lod, full)| lod - full).collect();
                if let Some(before) = &before {
                    let [faded_before, goals_before]: [Vec<f32>; 2] =
                        [before.iter().map(|b| b.0).collect(), before.iter().map(|b| b.1 as f32).collect()];
                    did.pop[0] = farthest(&lod, &picture(&kept(&faded_before)?)?);
                    let goals: Vec<f32> = now.iter().map(|(_, goal)| *goal as f32).collect();
                    if goals != goals_before {
                        did.pop[1] = farthest(&picture(&kept(&goals)?)?, &picture(&kept(&goals_before)?)?);
                    }
                }
                did.drift = off_before.replace(off.clone()).map_or(0.0, |before| farthest(&off, &before));
            }
            before = Some(now);
            tell(frame, &did);
            frames.push(did);
        }
        Ok(frames)
    }
}

fn scene(view: View) -> Scene {
    Scene { view, light: Light::default(), show: Show::Shaded }
}

/// Returns the largest difference.
fn farthest(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// Returns means of `by` × `by` pixels as displays show them: of linear light, then encoded, in units of 1/255, not
/// rounded.
fn shrunk(picture: &Picture, by: u32) -> Vec<f32> {
    let decoded: Vec<f32> = (0..256)
        .map(|byte| match byte as f32 / 255.0 {
            v if v <= 0.04045 => v / 12.92,
            v => ((v + 0.055) / 1.055).powf(2.4),
        })
        .collect();
    let encoded = |v: f32| if v <= 0.0031308 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    let ([width, height], by) = (picture.size.map(|pixels| (pixels / by) as usize), by as usize);
    let mut sums = vec![0.0f32; 3 * width * height];
    for (row, pixels) in picture.rgba.chunks_exact(4 * width * by).enumerate() {
        let sums = &mut sums[row / by * 3 * width..][..3 * width];
        for (column, pixel) in pixels.chunks_exact(4).enumerate() {
            let sum = &mut sums[column / by * 3..][..3];
            sum.iter_mut().zip(pixel).for_each(|(sum, byte)| *sum += decoded[*byte as usize]);
        }
    }
    sums.into_iter().map(|sum| 255.0 * encoded(sum / (by * by) as f32)).collect()
}
