//! `textures`: the delta textures of a mesh as a KTX2 file, which `--textures` reads again.

use crate::args::TexturesArgs;
use crate::input;
use crate::output::{Failure, Output};
use crate::table::{bytes, sig3};
use deltamorph::textures::{TextureFloats, read_ktx2, write_ktx2};
use deltamorph::{DeltaFormat, MorphMesh, PackDesc, PackedMesh};
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
    /// By how much a number of a delta of positions or normals was rounded, at most; 0 for 32-bit floats.
    rounding: f64,
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
        rounding: rounding(&packed, &read_ktx2(&args.output, &input.kept)?)?,
    };
    let Written { output, vertices, targets, rounding, .. } = &written;
    let (size, rounding) = (bytes(file.len() as f64), sig3(*rounding));
    out.say(format!("{output}: {vertices} vertices, {targets} targets, {size}, numbers rounded by at most {rounding}"));
    out.json(&written)
}

/// The largest difference of a number of positions or normals between the file, as it is read, and what was written.
fn rounding(written: &PackedMesh, read: &MorphMesh) -> Result<f64, Failure> {
    let read = PackedMesh::pack(read, &PackDesc::new(DeltaFormat::Float32))?;
    let pairs = written.deltas().iter().zip(read.deltas());
    let of = |bits: &u32| f64::from(f32::from_bits(*bits));
    Ok(pairs.map(|(a, b)| (of(a) - of(b)).abs()).fold(0.0, f64::max))
}
