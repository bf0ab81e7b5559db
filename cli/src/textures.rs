//! `textures`: the delta textures of a mesh as a KTX2 file, which `--textures` reads again.

use crate::args::TexturesArgs;
use crate::input;
use crate::output::{Failure, Output};
use crate::table::{bytes, sig3};
use deltamorph::textures::{TextureFloats, read_ktx2, write_ktx2};
use deltamorph::{DeltaFormat, MorphMesh, POSE_FLOATS, PackDesc, PackedMesh};
use serde::Serialize;
use std::io::Write;

/// The JSON of `textures`. Fields may be added, never renamed.
#[derive(Serialize)]
struct Written {
    schema: u32,
    origin: String,
    output: String,
    vertices: usize,
    targets: usize,
    half: bool,
    file_bytes: usize,
    /// Texels of a row, rows, and layers: two for each group of streams.
    size: [u32; 3],
    /// Deltas of positions and normals, of all targets.
    deltas: usize,
    /// By how much a number was rounded, at most; 0 for 32-bit floats.
    rounding: Rounding,
}

/// Of deltas, at weight 1.
#[derive(Default, Serialize)]
struct Rounding {
    /// In input units.
    positions: f64,
    normals: f64,
    /// Tangents, texture coordinates, colours and masks.
    streams: f64,
}

pub fn run(args: &TexturesArgs, out: &Output) -> Result<(), Failure> {
    if !args.output.extension().is_some_and(|e| e.eq_ignore_ascii_case("ktx2")) {
        let name = args.output.display();
        return Err(Failure::Usage(format!("-o {name}: name it *.ktx2, so that it is known for what it is")));
    }
    out.check(&input::files_of(&args.input, &[]), &[&args.output], None)?;
    let input = input::load(&args.input, false, out)?;
    let packed = PackedMesh::pack(&input.kept, &PackDesc::new(DeltaFormat::Float32))?;
    let floats = if args.half { TextureFloats::Half } else { TextureFloats::Single };
    let file = write_ktx2(&packed, floats)?;
    deltamorph::internals::write_replacing(&args.output, |to| to.write_all(&file))?;
    let written = Written {
        schema: 1,
        origin: input.origin,
        output: args.output.display().to_string(),
        vertices: input.kept.vertex_count(),
        targets: input.kept.targets.len(),
        half: args.half,
        file_bytes: file.len(),
        size: [20, 24, 32].map(|at| u32::from_le_bytes(std::array::from_fn(|i| file[at + i]))),
        deltas: input.kept.targets.iter().map(|target| target.vertices.len()).sum(),
        rounding: rounding(&packed, &read_ktx2(&args.output, &input.kept)?)?,
    };
    let Written { output, vertices, targets, size: [width, height, layers], rounding, .. } = &written;
    let (size, [of_positions, of_normals]) =
        (bytes(file.len() as f64), [rounding.positions, rounding.normals].map(sig3));
    let rounded = match args.half {
        true => format!("positions rounded by at most {of_positions}, normals by {of_normals}"),
        false => "nothing rounded".to_owned(),
    };
    let image = format!("{layers} layers of {width} × {height} texels");
    out.say(format!("{output}: {vertices} vertices, {targets} targets, {image}, {size}, {rounded}"));
    out.json(&written)
}

/// The largest difference of a number between the file, as it is read, and what was written.
fn rounding(written: &PackedMesh, read: &MorphMesh) -> Result<Rounding, Failure> {
    let read = PackedMesh::pack(read, &PackDesc::new(DeltaFormat::Float32))?;
    let mut rounding = Rounding::default();
    for (group, (written, read)) in written.groups().iter().zip(read.groups()).enumerate() {
        for (i, (a, b)) in written.deltas().iter().zip(read.deltas()).enumerate() {
            let off = (f64::from(f32::from_bits(*a)) - f64::from(f32::from_bits(*b))).abs();
            let most = match (group, i % POSE_FLOATS) {
                (0, ..3) => &mut rounding.positions,
                (0, _) => &mut rounding.normals,
                _ => &mut rounding.streams,
            };
            *most = most.max(off);
        }
    }
    Ok(rounding)
}
