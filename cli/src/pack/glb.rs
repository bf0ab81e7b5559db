//! `pack -o FILE.glb`: a glTF file, and how far it is off as it is read back.

use crate::args::PackFileArgs;
use crate::args::values;
use crate::input;
use crate::output::{Failure, Output, write_file};
use crate::table::{bytes, sig3, thousands};
use deltamorph::import::gltf::{GlbDesc, to_glb};
use deltamorph::import::{ImportDesc, Imported, ImportedMesh, is_gltf, open};
use deltamorph::reference::angle_degrees;
use deltamorph::{MorphMesh, MorphSource};
use glam::Vec3;
use serde::Serialize;

/// The JSON of `pack -o FILE.glb`. Fields may be added, never renamed.
#[derive(Serialize)]
struct Written {
    schema: u32,
    origin: String,
    output: String,
    encoding: String,
    /// Vertices of the file: seams of texture coordinates double some of the mesh.
    vertices: usize,
    targets: usize,
    file_bytes: usize,
    #[serde(flatten)]
    off: Off,
}

/// Largest differences between INPUT and the file as it is read back.
#[derive(Debug, Default, Serialize)]
struct Off {
    /// Positions of the base pose, as a fraction of the diagonal.
    base_error_rel: f64,
    /// Positions with one target at weight 1, as a fraction of the diagonal.
    position_error_rel: f64,
    /// Normals of the base pose, and with one target at weight 1.
    normal_error_deg: f64,
}

pub fn run(args: &PackFileArgs, out: &Output) -> Result<(), Failure> {
    let PackFileArgs { output, pack, .. } = args;
    let given = [
        ("--format", args.format.is_some()),
        ("--block-size", pack.block_size.is_some()),
        ("--weight-max", pack.weight_max.is_some()),
    ];
    if let Some((option, _)) = given.iter().find(|(_, given)| *given) {
        let text = format!("{option}: is for *.dmorph files; -o {} takes --encoding", output.display());
        return Err(Failure::Usage(text));
    }
    out.check(&input::files_of(&args.input, &[]), &[output], None)?;
    // Errors are against the raw files, what the tolerance drops included.
    let input = input::load(&args.input, true, out)?;
    let spinner = out.spinner("writing glTF");
    let encoding = args.encoding.unwrap_or_default();
    let desc = GlbDesc::default()
        .encoding(encoding.into())
        .position_error(pack.position_error)
        .normal_error_degrees(pack.normal_error)
        .flip_texcoords(!args.input.input.as_deref().is_some_and(is_gltf));
    let glb = to_glb(&input.kept, &desc)?;
    glb.notes.iter().for_each(|note| out.note(note));
    write_file(output, &glb.bytes)?;
    let Imported { mesh: ImportedMesh::Source(read), .. } = open(output, &ImportDesc::default())? else {
        return Err(Failure::failed(format!("{}: is read back as a packed file", output.display())));
    };
    spinner.finish_and_clear();
    let written = Written {
        schema: 1,
        origin: input.origin,
        output: output.display().to_string(),
        encoding: values::name(encoding),
        vertices: glb.vertices.len(),
        targets: input.kept.targets.len(),
        file_bytes: glb.bytes.len(),
        off: Off::of(&input.raw, &read, &glb.vertices)?,
    };
    out.say(text(&written));
    out.json(&written)
}

/// The result in words.
fn text(w: &Written) -> String {
    let Written { output, targets, encoding, off, .. } = w;
    let (vertices, size) = (thousands(w.vertices), bytes(w.file_bytes as f64));
    let [base, position, normal] = [off.base_error_rel, off.position_error_rel, off.normal_error_deg].map(sig3);
    format!(
        "{output}: {vertices} vertices, {targets} targets, encoding {encoding}, {size}\n\
         read back, largest error at weight 1: {position} of the diagonal ({base} in the base pose), normals {normal}°"
    )
}

impl Off {
    /// Compares `read` with `mesh`; `vertices` says which vertex of the mesh each of `read` is.
    fn of(mesh: &MorphMesh, read: &MorphSource, vertices: &[u32]) -> Result<Self, Failure> {
        let Some(normals) = read.normals.as_ref().filter(|_| read.positions.len() == vertices.len()) else {
            return Err(Failure::Failed("the file is read back as another mesh; report this".into()));
        };
        let (mut off, length) = (Self::default(), 1.0 / f64::from(mesh.diagonal).max(f64::MIN_POSITIVE));
        // In double precision: the origin is added to neither.
        let place = |p: Vec3| p.as_dvec3() - mesh.origin.as_dvec3();
        let mut deltas = [vec![], vec![], vec![], vec![]];
        let still = (None, None);
        let pairs = mesh.targets.iter().zip(&read.targets).map(|(own, read)| (Some(own), Some(read)));
        for (own, read_target) in std::iter::once(still).chain(pairs) {
            deltas[..2].iter_mut().for_each(|list| {
                list.clear();
                list.resize(mesh.vertex_count(), Vec3::ZERO);
            });
            deltas[2..].iter_mut().for_each(|list| {
                list.clear();
                list.resize(vertices.len(), Vec3::ZERO);
            });
            if let Some((own, read)) = own.zip(read_target) {
                for (i, v) in own.vertices.iter().enumerate() {
                    (deltas[0][*v as usize], deltas[1][*v as usize]) = (own.positions[i], own.normals[i]);
                }
                read.positions.iter().for_each(|(v, d)| deltas[2][*v as usize] = *d);
                read.normals.iter().flatten().for_each(|(v, d)| deltas[3][*v as usize] = *d);
            }
            for (at, &v) in vertices.iter().enumerate() {
                let v = v as usize;
                let [moved, turned, read_moved, read_turned] =
                    [deltas[0][v], deltas[1][v], deltas[2][at], deltas[3][at]].map(Vec3::as_dvec3);
                let apart = place(read.positions[at]) + read_moved - mesh.positions[v].as_dvec3() - moved;
                let apart = apart.length() * length;
                off.position_error_rel = off.position_error_rel.max(apart);
                if own.is_none() {
                    off.base_error_rel = off.base_error_rel.max(apart);
                }
                let angle = angle_degrees(mesh.normals[v].as_dvec3() + turned, normals[at].as_dvec3() + read_turned);
                off.normal_error_deg = off.normal_error_deg.max(angle);
            }
        }
        Ok(off)
    }
}
