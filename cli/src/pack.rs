//! `pack`: writes a mesh as a file that loads without packing again.

use crate::args::PackFileArgs;
use crate::info::measure::Cost;
use crate::info::pose_formats::{PoseCost, Sample, pose_costs, pose_table};
use crate::input;
use crate::output::{Failure, Output, check_ending};
use crate::table::{bytes, sig3, thousands};
use deltamorph::import::{self, packed};
use deltamorph::{Asset, DeltaFormat, PackDesc, WeightClip};
use glam::Vec3;
use serde::Serialize;
use std::sync::Arc;

/// The JSON of `pack`. Fields may be added, never renamed.
#[derive(Serialize)]
struct Packed {
    schema: u32,
    origin: String,
    output: String,
    format: &'static str,
    vertices: usize,
    targets: usize,
    block_size: usize,
    blocks: usize,
    /// Blocks that any target moves.
    blocks_moved: usize,
    /// Pairs of a block and a target that moves some of its vertices.
    entries: usize,
    file_bytes: u64,
    /// Weight clips in the file: those of a glTF file.
    clips: usize,
    #[serde(flatten)]
    cost: Cost,
    /// Costs and errors of each pose format.
    pose_formats: Vec<PoseCost>,
}

pub fn run(args: &PackFileArgs, out: &Output) -> Result<(), Failure> {
    check_ending(&args.output, "a packed mesh", &["dmorph"])?;
    let format = Some(args.format.unwrap_or(DeltaFormat::Small)).filter(|f| f.is_blocks()).ok_or_else(|| {
        let names = DeltaFormat::BLOCKS.map(DeltaFormat::name).join(", ");
        Failure::Usage(format!("--format: packed files hold blocks; name one of {names}"))
    })?;
    out.check(&input::files_of(&args.input, &[]), &[&args.output], None)?;
    let mut input = input::load(&args.input, true, out)?;
    // Files hold positions relative to 0.
    let origin = input.kept.origin;
    if input.kept.positions.iter().any(|position| *position + origin - origin != *position) {
        out.note(format_args!("positions of the file are relative to {origin}: it cannot hold them so far from 0"));
        Arc::make_mut(&mut input.kept).origin = Vec3::ZERO;
    }
    if let Some(mesh) = &input.packed {
        let lost = sig3(mesh.layout().blocks.as_ref().map_or(0.0, |b| b.error().position));
        let origin = &input.origin;
        out.note(format_args!("{origin} lost {lost} in length when it was packed; the error below is on top of that"));
    }
    let spinner = out.spinner("packing");
    let desc = PackDesc::new(format).blocks(args.pack.desc());
    let asset = Asset::pack(&input.kept, &desc);
    spinner.finish_and_clear();
    let asset = asset?;
    // Clips of a folder stay files of their own.
    let kept = input.clips.iter().filter(|clip| import::animation_of(clip).is_some());
    let clips: Vec<WeightClip> =
        kept.filter_map(|clip| input.unless_bad(import::open_clip(clip, args.input.fps))).collect();
    packed::write(&args.output, &asset, &clips)?;
    let sample = Sample::new(&input, &args.input, args.pack.weight_max);
    let file_bytes = args.output.metadata().map_err(|e| Failure::io(&args.output, "read", e))?.len();
    let mesh = Arc::new(asset.mesh);
    let layout = mesh.layout();
    let Some(index) = &layout.blocks else { return Ok(()) }; // `Asset::pack` takes no other format
    let facts = Packed {
        schema: 1,
        origin: input.origin.clone(),
        output: args.output.display().to_string(),
        format: layout.format.name(),
        vertices: layout.vertex_count,
        targets: layout.targets.len(),
        block_size: index.size(),
        blocks: index.count(),
        blocks_moved: index.touched(),
        entries: index.entry_count(),
        file_bytes,
        clips: clips.len(),
        cost: Cost::of(layout, index.error()),
        pose_formats: pose_costs(&mesh, false, &sample),
    };
    out.say(text(&facts, &sample));
    out.json(&facts)
}

/// The result in words.
fn text(p: &Packed, sample: &Sample<'_>) -> String {
    let Packed { output, targets, format, block_size, cost, .. } = p;
    let deltas = cost.delta_bytes + cost.index_bytes;
    let times = match deltas {
        0 => String::new(),
        deltas => format!(", {} times as much", sig3(cost.dense_f32_bytes as f64 / deltas as f64)),
    };
    let [file, deltas, dense] = [p.file_bytes, deltas, cost.dense_f32_bytes].map(|n| bytes(n as f64));
    let [vertices, entries, moved, blocks] = [p.vertices, p.entries, p.blocks_moved, p.blocks].map(thousands);
    let [position, normal] = [cost.position_error_rel, cost.normal_error_deg].map(sig3);
    let clips = match p.clips {
        0 => String::new(),
        1 => "; a weight clip".to_owned(),
        n => format!("; {n} weight clips"),
    };
    let poses = pose_table(&p.pose_formats, sample);
    format!(
        "{output}: {vertices} vertices, {targets} targets as {format}, {file}{clips}\n\
         deltas: {deltas} in {entries} entries, {moved} of {blocks} blocks of {block_size} vertices; \
         as dense float32: {dense}{times}\n\
         largest error of a target at weight 1: {position} of the diagonal, normals {normal}°\n\
         \n{poses}"
    )
}
