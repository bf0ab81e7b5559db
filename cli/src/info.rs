//! `info`: what a mesh is made of, and what each format makes of it.

mod formats;
mod record;
mod report;
mod sweep;

use crate::args::InfoArgs;
use crate::clips;
use crate::input::{self, Input};
use crate::output::{Failure, Output};
use crate::table::{Table, bytes, percent, sig3, thousands};
use deltamorph::{BoundClip, DeltaFormat, MorphMesh, MorphTarget};
use glam::Vec3;
use record::{Blocks, ClipRow, Info, Overlap, TargetRow};

pub fn run(args: &InfoArgs, out: &Output) -> Result<(), Failure> {
    // Before seconds are spent on what then cannot be written.
    out.check(&input::files_of(&args.input, &[]), &[], args.report.as_deref())?;
    if let Some(dir) = &args.report {
        report::claim(dir)?;
    }
    let input = input::load(&args.input, true, out)?;
    let spinner = out.spinner("packing");
    let mut info = describe(&input);
    let packed = formats::pack_all(&input.kept, input.packed.as_ref())?;
    info.formats = packed.iter().map(|p| formats::format_row(&input.kept, input.packed.as_deref(), p)).collect();
    info.blocks =
        packed.iter().find(|p| p.layout().format == DeltaFormat::Small).map(|p| formats::blocks(p)).unwrap_or_default();
    for path in &input.clips {
        info.clips.push(clip_row(&input::clip(path, &args.input, &input.kept)?));
    }
    spinner.finish_and_clear();
    if let Some(dir) = &args.report {
        let clips = clips::all(None, &args.input, &input)?;
        info.sweep = Some(sweep::sweep(&input.kept, &packed, out)?);
        info.poses = Some(sweep::poses(&input, &packed, &clips, out));
        report::write(&info, dir)?;
    }
    out.say(text(&info));
    if let Some(dir) = &args.report {
        out.say(format_args!("\nreport: {}", dir.join("index.html").display()));
    }
    out.json(&info)
}

/// Everything that needs no packing.
fn describe(input: &Input) -> Info {
    let (kept, raw) = (&input.kept, &input.raw);
    let vertices = kept.vertex_count();
    let share = |n: usize| n as f64 / vertices.max(1) as f64;
    let length = |deltas: &[Vec3]| deltas.iter().map(|d| d.length()).fold(0.0, f32::max);
    let differs = |target: &MorphTarget| target.positions.iter().filter(|d| **d != Vec3::ZERO).count();
    Info {
        schema: 1,
        input: input.info(),
        targets: (kept.targets.iter().zip(&raw.targets))
            .map(|(kept, raw)| TargetRow {
                name: kept.name.clone(),
                moved: share(kept.vertices.len()),
                moved_raw: share(raw.vertices.len()),
                moved_raw_positions: share(differs(raw)),
                max_delta: length(&kept.positions),
                max_normal_delta: length(&kept.normals),
            })
            .collect(),
        overlap: overlap(kept),
        blocks: Blocks::default(),
        formats: Vec::new(),
        clips: Vec::new(),
        sweep: None,
        poses: None,
    }
}

fn overlap(mesh: &MorphMesh) -> Overlap {
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

/// How busy a clip is. The first frame has none before it and counts for `active` only.
fn clip_row(clip: &BoundClip) -> ClipRow {
    let (mut changed, mut active) = (vec![], 0);
    let mut before: Option<Vec<f32>> = None;
    for weights in clip.frames() {
        active += weights.iter().filter(|w| **w != 0.0).count();
        changed.extend(before.map(|before| weights.iter().zip(&before).filter(|(a, b)| a != b).count()));
        before = Some(weights);
    }
    let mean = |sum: usize, n: usize| sum as f64 / n.max(1) as f64;
    ClipRow {
        name: clip.name.clone(),
        frames: clip.frame_count(),
        fps: clip.fps,
        columns: clip.column_count(),
        changed_mean: mean(changed.iter().sum(), changed.len()),
        changed_max: changed.iter().copied().max().unwrap_or(0),
        active_mean: mean(active, clip.frame_count()),
        still: mean(changed.iter().filter(|&&n| n == 0).count(), changed.len()),
    }
}

/// The same for people.
fn text(info: &Info) -> String {
    let i = &info.input;
    let mut parts = vec![format!(
        "{} ({})\n{} vertices, {} triangles, {} targets, diagonal {}\n\
         deltas kept: longer than {} of the diagonal (normals: {})",
        i.name,
        i.origin,
        thousands(i.vertices),
        thousands(i.triangles),
        i.targets,
        sig3(i.diagonal.into()),
        sig3(i.tolerance.into()),
        sig3(i.tolerance_normal.into()),
    )];
    let mut table = Table::new(
        &["target", "moved", "without tolerance", "positions in the file", "largest delta", "of diagonal"],
        1,
    );
    for t in &info.targets {
        let largest = f64::from(t.max_delta);
        table.row([
            t.name.clone(),
            percent(t.moved),
            percent(t.moved_raw),
            percent(t.moved_raw_positions),
            sig3(largest),
            if i.diagonal > 0.0 { percent(largest / f64::from(i.diagonal)) } else { "–".into() },
        ]);
    }
    parts.push(table.to_string());
    let (o, b) = (&info.overlap, &info.blocks);
    parts.push(format!(
        "{} of the vertices are moved by some target; each of these by {} targets on average, {} at most\n\
         {} blocks of {} vertices in the format small: {} block-target pairs, {} full",
        percent(o.union),
        sig3(o.mean),
        o.max,
        thousands(b.count),
        b.size,
        thousands(b.incidence),
        percent(b.fill),
    ));
    if !info.formats.is_empty() {
        let mut table =
            Table::new(&["format", "deltas", "index", "dense float32", "position error", "normal error"], 1);
        for f in &info.formats {
            table.row([
                f.name.clone(),
                bytes(f.delta_bytes as f64),
                bytes(f.index_bytes as f64),
                bytes(f.dense_f32_bytes as f64),
                format!("{} of the diagonal", sig3(f.position_error_rel)),
                format!("{}°", sig3(f.normal_error_deg)),
            ]);
        }
        parts.push(table.to_string());
    }
    if !info.clips.is_empty() {
        let mut table =
            Table::new(&["clip", "frames", "fps", "changed per frame", "most", "active", "still frames"], 1);
        for c in &info.clips {
            table.row([
                c.name.clone(),
                c.frames.to_string(),
                c.fps.to_string(),
                sig3(c.changed_mean),
                c.changed_max.to_string(),
                sig3(c.active_mean),
                percent(c.still),
            ]);
        }
        parts.push(table.to_string());
    }
    parts.join("\n\n")
}

#[cfg(test)]
#[path = "info/tests.rs"]
pub mod tests;
