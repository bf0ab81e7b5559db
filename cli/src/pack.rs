//! `pack`: writes a mesh as a file that loads without packing again.

use crate::args::PackFileArgs;
use crate::info::measure::Measured;
use crate::info::pose_formats::{Sample, pose_table};
use crate::input;
use crate::output::{Failure, Output, Result, With, check_ending};
use crate::table::{bytes, sig3, thousands};
use deltamorph::{DeltaFormat, PackDesc, PackedMesh, import};
use glam::Vec3;
use serde_json::json;
use std::sync::Arc;
use std::time::Instant;

pub fn run(args: &PackFileArgs, out: &Output) -> Result<()> {
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
        out.warn(format_args!(
            "positions in the file are relative to {origin}: so far from 0, they would lose precision"
        ));
        Arc::make_mut(&mut input.kept).origin = Vec3::ZERO;
    }
    if let Some(mesh) = &input.packed {
        let lost = sig3(mesh.layout().error().map_or(0.0, |error| error.position));
        let origin = &input.origin;
        out.warn(format_args!(
            "{origin} has an error of {lost} from when it was packed; the errors below do not include it"
        ));
    }
    let spinner = out.spinner("packing");
    let desc = PackDesc { blocks: args.pack.desc(), ..PackDesc::new(format) };
    let begun = Instant::now();
    let mesh = PackedMesh::pack(&input.kept, &desc);
    let seconds = [input.seconds[0], input.seconds[1] + begun.elapsed().as_secs_f64()];
    drop(spinner);
    let mut mesh = mesh?;
    // Clips of a folder stay files of their own.
    let kept = input.clips.iter().filter(|clip| import::animation_of(clip).is_some());
    mesh.clips = kept.filter_map(|clip| input.unless_bad(import::open_clip(clip, args.input.fps))).collect();
    mesh.write(&args.output)?;
    let sample = Sample::new(&input, args.pack.weight_max);
    let file_bytes = args.output.metadata().map_err(|e| Failure::io(&args.output, "read", e))?.len();
    let mesh = Arc::new(mesh);
    let layout = mesh.layout();
    let Some(index) = &layout.blocks else { return Ok(()) }; // files hold no other format
    let measured = Measured::of(&mesh, false, &sample);
    let Measured { delta_bytes, index_bytes, dense_f32_bytes, .. } = measured;
    let output = args.output.display();
    let times = match delta_bytes + index_bytes {
        0 => String::new(),
        deltas => format!(", {} times as large", sig3(dense_f32_bytes as f64 / deltas as f64)),
    };
    let [file, deltas, dense] = [file_bytes, delta_bytes + index_bytes, dense_f32_bytes].map(|n| bytes(n as f64));
    let [vertices, entries, moved, blocks] =
        [layout.vertex_count, index.entry_count(), index.touched(), index.count()].map(thousands);
    let [position, normal] = [measured.position_error_rel, measured.normal_error_deg].map(sig3);
    let speed = sig3(dense_f32_bytes as f64 / 1e6 / seconds[1]);
    let [read, took] = seconds.map(sig3);
    let clip_count = match mesh.clips.len() {
        0 => String::new(),
        1 => "; a weight clip".to_owned(),
        n => format!("; {n} weight clips"),
    };
    out.say(format_args!(
        "{output}: {vertices} vertices, {} targets as {}, {file}{clip_count}\n\
         deltas: {deltas} in {entries} entries, {moved} of {blocks} blocks of {} vertices; \
         as dense float32: {dense}{times}\n\
         largest error of a target at weight 1: {position} of the diagonal, normals {normal}°\n\
         read in {read} s, packed in {took} s: {speed} MB of float32 deltas a second\n\
         \n{}",
        layout.targets.len(),
        measured.name,
        index.size(),
        pose_table(&measured.pose_formats, &sample)
    ));
    // Fields may be added, never renamed. `blocks_moved` are those that any target moves, `entries` pairs of a block
    // and a target that moves some of its vertices, `clips` those of a glTF file, which the packed file keeps.
    let more = json!({
        "schema": 1, "origin": input.origin, "output": output.to_string(), "format": measured.name,
        "vertices": layout.vertex_count, "targets": layout.targets.len(), "block_size": index.size(),
        "blocks": index.count(), "blocks_moved": index.touched(), "entries": index.entry_count(),
        "file_bytes": file_bytes, "clips": mesh.clips.len(), "read_seconds": seconds[0], "pack_seconds": seconds[1],
    });
    out.json(&With { fields: measured, more })
}
