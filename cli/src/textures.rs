//! `textures`: writes the delta textures of a mesh as a KTX2 file.

use crate::args::TexturesArgs;
use crate::input;
use crate::output::{Failure, Output, check_ending};
use crate::table::{bytes, sig3, thousands};
use deltamorph::{DeltaFormat, PackDesc, PackedMesh};
use deltamorph_baselines::textures::{TextureFloats, write_ktx2};
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
    /// Width of a layer in texels, and its height.
    width: u32,
    height: u32,
    layers: u32,
    /// Texels of a layer that hold deltas, over all groups of streams.
    texels_covered: usize,
    /// By stream: positions, normals, and further streams of the mesh.
    rounding: Vec<Rounding>,
}

#[derive(Serialize)]
struct Rounding {
    stream: String,
    /// Largest rounding of a component of a delta, in the units of the stream; 0 for 32-bit floats.
    largest: f64,
}

pub fn run(args: &TexturesArgs, out: &Output) -> Result<(), Failure> {
    out.check(&input::files_of(&args.input, &[]), &[&args.output], None)?;
    check_ending(&args.output, "a KTX2 file", &["ktx2"])?;
    let input = input::load(&args.input, false, out)?;
    let spinner = out.spinner("writing textures");
    let packed = PackedMesh::pack(&input.kept, &PackDesc::new(DeltaFormat::Float32))?;
    let floats = if args.half { TextureFloats::Half } else { TextureFloats::Single };
    let file = write_ktx2(&packed, floats)?;
    deltamorph::internals::write_replacing(&args.output, |to| to.write_all(&file.bytes))?;
    let mut rounding = vec![];
    for (group, of_group) in packed.groups().iter().zip(&file.rounding) {
        for place in &group.layout().streams {
            let largest = of_group[place.morphing_components()].iter().copied().fold(0.0, f64::max);
            rounding.push(Rounding { stream: place.semantic.to_string(), largest });
        }
    }
    spinner.finish_and_clear();
    let written = Written {
        schema: 1,
        origin: input.origin,
        output: args.output.display().to_string(),
        vertices: input.kept.vertex_count(),
        targets: input.kept.targets.len(),
        half: args.half,
        file_bytes: file.bytes.len(),
        width: file.size[0],
        height: file.size[1],
        layers: file.layers,
        texels_covered: file.covered,
        rounding,
    };
    out.say(text(&written));
    out.json(&written)
}

/// The result in words.
fn text(w: &Written) -> String {
    let Written { output, targets, width, height, layers, .. } = w;
    let [vertices, covered] = [w.vertices, w.texels_covered].map(thousands);
    let (floats, size) = (if w.half { "16-bit" } else { "32-bit" }, bytes(w.file_bytes as f64));
    let rounding: Vec<_> = w.rounding.iter().map(|r| format!("{} {}", r.stream, sig3(r.largest))).collect();
    format!(
        "{output}: {vertices} vertices, {targets} targets as {floats} floats, {size}\n\
         textures: {width} × {height} texels, {layers} layers; deltas cover {covered} texels\n\
         rounded by at most: {}",
        rounding.join(", ")
    )
}
