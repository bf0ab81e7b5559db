//! `info`: describes a mesh, and the cost of each format.

pub mod measure;
pub mod pose_formats;

use crate::args::InfoArgs;
use crate::input::{self, Input, MeshInfo};
use crate::output::{Output, Result};
use crate::table::{Column, Table, bytes, percent, sig3, thousands};
use deltamorph::mesh::KeptTarget;
use deltamorph::{BoundClip, DeltaFormat, KeptMesh};
use glam::Vec3;
use measure::{Blocks, Measured};
use pose_formats::{PoseCost, Sample, pose_table};
use serde::Serialize;

/// The JSON of `info`. Fields may be added, never renamed.
#[derive(Serialize)]
struct Info {
    schema: u32,
    input: MeshInfo,
    /// The targets, in the order of the input.
    targets: Vec<TargetRow>,
    /// Vertex streams besides position and normal.
    streams: Vec<String>,
    overlap: Overlap,
    /// Block statistics of the format `small`, or of the first one measured.
    blocks: Blocks,
    formats: Vec<Measured>,
    /// Costs and errors of each pose format, with the deltas of the packed file, of the format `small`, or of the first
    /// one measured.
    pose_formats: Vec<PoseCost>,
    /// The format of these deltas.
    pose_deltas: &'static str,
    /// The weight clips beside the mesh.
    clips: Vec<ClipRow>,
}

#[derive(Serialize)]
struct TargetRow {
    name: String,
    /// Fraction of the vertices with a delta that was kept.
    moved: f64,
    /// Fraction of the vertices with a nonzero delta of position or normal.
    moved_raw: f64,
    /// Fraction of the vertices with a different position in the file.
    moved_raw_positions: f64,
    /// Length of the longest position delta, in input units.
    max_delta: f32,
}

#[derive(Serialize)]
struct Overlap {
    /// Fraction of the vertices that any target moves.
    union: f64,
    /// Mean number of targets that move such a vertex.
    mean: f64,
    /// Largest number of targets that move a vertex.
    max: u32,
}

#[derive(Serialize)]
struct ClipRow {
    name: String,
    frames: usize,
    fps: f32,
    /// Mean number of targets with a weight that differs from the frame before.
    changed_mean: f64,
    /// Largest such number.
    changed_max: usize,
    /// Mean number of targets with a weight other than 0.
    active_mean: f64,
    /// Fraction of the frames that change nothing.
    still: f64,
}

pub fn run(args: &InfoArgs, out: &Output) -> Result<()> {
    out.check(&input::files_of(&args.input, &[]), &[], None)?;
    let input = input::load(&args.input, true, out)?;
    let sample = Sample::new(&input, None);
    let formats = measure::measure_all(&formats(&input, out), &input, &sample, out)?;
    let info = describe(&input, formats, &sample.clips);
    out.say(text(&info, &sample));
    out.json(&info)
}

/// More deltas than these take seconds to pack in each format.
const MANY: usize = 1_000_000;

/// All formats, or one if that takes long.
fn formats(input: &Input, out: &Output) -> Vec<DeltaFormat> {
    let deltas: usize = input.kept.targets.iter().map(|target| target.vertices.len()).sum();
    if deltas <= MANY {
        return DeltaFormat::ALL.to_vec();
    }
    let one = input.packed.as_ref().map_or(DeltaFormat::Fast, |packed| packed.layout().format);
    let (deltas, name) = (thousands(deltas), one.name());
    out.warn(format_args!("{deltas} deltas: only the format {name} is measured; `pack --format` measures others"));
    vec![one]
}

fn describe(input: &Input, formats: Vec<Measured>, clips: &[BoundClip]) -> Info {
    let (kept, raw) = (&input.kept, &input.raw);
    let vertices = kept.vertex_count();
    let share = |n: usize| n as f64 / vertices.max(1) as f64;
    let differs = |target: &KeptTarget| target.positions.iter().filter(|d| **d != Vec3::ZERO).count();
    let held = input.packed.as_ref().map_or(DeltaFormat::Small, |packed| packed.layout().format);
    let of = |format: DeltaFormat| formats.iter().find(|m| m.name == format.name()).unwrap_or(&formats[0]);
    let (blocks, held) = (of(DeltaFormat::Small).blocks, of(held));
    Info {
        schema: 1,
        input: input.info(),
        targets: (kept.targets.iter().zip(&raw.targets))
            .map(|(kept, raw)| TargetRow {
                name: kept.name.clone(),
                moved: share(kept.vertices.len()),
                moved_raw: share(raw.vertices.len()),
                moved_raw_positions: share(differs(raw)),
                max_delta: kept.positions.iter().map(|d| d.length()).fold(0.0, f32::max),
            })
            .collect(),
        streams: kept.streams.iter().map(|stream| stream.semantic.to_string()).collect(),
        overlap: overlap(kept),
        blocks,
        pose_deltas: held.name,
        pose_formats: held.pose_formats.clone(),
        formats,
        clips: clips.iter().map(clip_row).collect(),
    }
}

fn overlap(mesh: &KeptMesh) -> Overlap {
    let mut per_vertex = vec![0u32; mesh.vertex_count()];
    for &v in mesh.targets.iter().flat_map(|t| &t.vertices) {
        per_vertex[v as usize] += 1;
    }
    let moved = per_vertex.iter().filter(|&&n| n > 0).count();
    let deltas: u64 = per_vertex.iter().map(|&n| u64::from(n)).sum();
    Overlap {
        union: moved as f64 / per_vertex.len().max(1) as f64,
        mean: deltas as f64 / moved.max(1) as f64,
        max: per_vertex.into_iter().max().unwrap_or(0),
    }
}

/// Statistics of a clip. The first frame has no predecessor: it counts only for `active`.
fn clip_row(clip: &BoundClip) -> ClipRow {
    let frames: Vec<_> = clip.frames().collect();
    let active = frames.iter().flatten().filter(|weight| **weight != 0.0).count();
    let changes = |pair: &[Vec<f32>]| pair[0].iter().zip(&pair[1]).filter(|(a, b)| a != b).count();
    let changed: Vec<usize> = frames.windows(2).map(changes).collect();
    let mean = |sum: usize, n: usize| sum as f64 / n.max(1) as f64;
    ClipRow {
        name: clip.name.clone(),
        frames: frames.len(),
        fps: clip.fps,
        changed_mean: mean(changed.iter().sum(), changed.len()),
        changed_max: changed.iter().copied().max().unwrap_or(0),
        active_mean: mean(active, frames.len()),
        still: mean(changed.iter().filter(|&&n| n == 0).count(), changed.len()),
    }
}

/// The result in words.
fn text(info: &Info, sample: &Sample<'_>) -> String {
    let i = &info.input;
    let MeshInfo { name, origin, targets, .. } = i;
    let [vertices, triangles] = [i.vertices, i.triangles].map(thousands);
    let [diagonal, all, position, normal] =
        [i.diagonal, i.bounding_box, i.tolerance, i.tolerance_normal].map(|v| sig3(v.into()));
    let of = match all == diagonal {
        true => String::new(),
        false => format!(
            " (of the bounding box of the smallest group of parts that targets move; lengths are fractions of it; \
             whole mesh: {all})"
        ),
    };
    let mut parts = vec![format!(
        "{name} ({origin})\n{vertices} vertices, {triangles} triangles, {targets} targets, diagonal {diagonal}{of}\n\
         deltas kept: longer than {position} of the diagonal (normals: {normal})"
    )];
    if i.pose_origin != [0.0; 3] {
        let [x, y, z] = i.pose_origin.map(|v| sig3(v.into()));
        parts.push(format!("poses are relative to ({x}, {y}, {z}), since the mesh is far from 0"));
    }
    if !info.streams.is_empty() {
        parts.push(format!("further streams: {}", info.streams.join(", ")));
    }
    let of_diagonal = |length: f32| if i.diagonal > 0.0 { percent((length / i.diagonal).into()) } else { "–".into() };
    let targets: &[Column<'_, TargetRow>] = &[
        ("target", &|t| t.name.clone()),
        ("moved", &|t| percent(t.moved)),
        ("without tolerance", &|t| percent(t.moved_raw)),
        ("positions in the file", &|t| percent(t.moved_raw_positions)),
        ("largest delta", &|t| sig3(t.max_delta.into())),
        ("of diagonal", &|t| of_diagonal(t.max_delta)),
    ];
    parts.push(Table::of(&info.targets, 1, targets).to_string());
    let (Overlap { union, mean, max }, Blocks { format, size, count, incidence, fill }) = (&info.overlap, &info.blocks);
    let ([union, fill], mean) = ([union, fill].map(|share| percent(*share)), sig3(*mean));
    let [count, pairs] = [count, incidence].map(|n| thousands(*n));
    parts.push(format!(
        "{union} of the vertices are affected by targets, each of them by {mean} targets on average, {max} at most\n\
         {count} blocks of {size} vertices in the format {format}: {pairs} block-target pairs, {fill} full"
    ));
    let formats: &[Column<'_, Measured>] = &[
        ("format", &|f| f.name.into()),
        ("deltas", &|f| bytes(f.delta_bytes as f64)),
        ("index", &|f| bytes(f.index_bytes as f64)),
        ("dense float32", &|f| bytes(f.dense_f32_bytes as f64)),
        ("position error", &|f| format!("{} of the diagonal", sig3(f.position_error_rel))),
        ("normal error", &|f| format!("{}°", sig3(f.normal_error_deg))),
    ];
    parts.push(Table::of(&info.formats, 1, formats).to_string());
    let held = info.formats.iter().find(|f| f.name == info.pose_deltas);
    // For `blocks`, and for `compute`.
    let dense = info.formats.iter().find(|f| f.name == DeltaFormat::Snorm16.name() && f.name != info.pose_deltas);
    for f in held.into_iter().chain(dense) {
        parts.push(format!("deltas in {}:\n{}", f.name, pose_table(&f.pose_formats, sample)));
    }
    let clips: &[Column<'_, ClipRow>] = &[
        ("clip", &|c| c.name.clone()),
        ("frames", &|c| c.frames.to_string()),
        ("fps", &|c| c.fps.to_string()),
        ("changed per frame", &|c| sig3(c.changed_mean)),
        ("most", &|c| c.changed_max.to_string()),
        ("active", &|c| sig3(c.active_mean)),
        ("still frames", &|c| percent(c.still)),
    ];
    if !info.clips.is_empty() {
        parts.push(Table::of(&info.clips, 1, clips).to_string());
    }
    parts.join("\n\n")
}

#[cfg(test)]
#[path = "info/tests.rs"]
pub mod tests;
