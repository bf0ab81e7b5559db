//! OBJ export.

use crate::asset::{Faces, MorphMesh};
use crate::error::{Error, Result, ensure};
use crate::io::write_replacing;
use glam::{Vec2, Vec3};
use std::io::{self, Write};
use std::path::Path;

/// The parts of a mesh that an OBJ file holds. Vertices are written in the order given.
#[derive(Clone, Copy, Debug)]
pub struct ObjMesh<'a> {
    /// Positions.
    pub positions: &'a [Vec3],
    /// One normal per position, or none.
    pub normals: &'a [Vec3],
    /// Texture coordinates, indexed by the faces.
    pub texcoords: &'a [Vec2],
    /// The face list; polygons are written as polygons.
    pub faces: &'a Faces,
}

impl<'a> From<&'a MorphMesh> for ObjMesh<'a> {
    /// Takes the base pose.
    fn from(mesh: &'a MorphMesh) -> Self {
        Self { positions: &mesh.positions, normals: &mesh.normals, texcoords: &mesh.texcoords, faces: &mesh.faces }
    }
}

/// Writes `mesh` to the file `path`. The old content is replaced when the new file is complete.
///
/// # Errors
/// [`Error::Io`] if the file cannot be written; [`Error::Invalid`] if a value is not finite, an index is out of range,
/// or the number of normals is neither 0 nor that of positions.
pub fn write_obj(path: &Path, mesh: ObjMesh<'_>) -> Result<()> {
    check(&mesh)?;
    write_replacing(path, |out| write_obj_to(out, mesh))
}

fn check(mesh: &ObjMesh<'_>) -> Result<()> {
    let refuse = |what: String| Error::invalid(what, "write a mesh that to_mesh() has accepted");
    let v = mesh.positions.len();
    let vt = mesh.texcoords.len();
    let vn = mesh.normals.len();
    ensure!(vn == 0 || vn == v, refuse(format!("{vn} normals for {v} vertices")));
    for (name, vectors) in [("vertex", mesh.positions), ("the normal of vertex", mesh.normals)] {
        if let Some(i) = vectors.iter().position(|p| !p.is_finite()) {
            return Err(refuse(format!("{name} {i} is not finite: {}", vectors[i])));
        }
    }
    if let Some(i) = mesh.texcoords.iter().position(|t| !t.is_finite()) {
        return Err(refuse(format!("texture coordinate {i} is not finite: {}", mesh.texcoords[i])));
    }
    mesh.faces.check(v, vt)
}

/// Writes `mesh` as OBJ text: `v`, `vt`, `vn` with nine significant digits (so that every `f32` reads back unchanged),
/// then `f v/vt/vn`.
///
/// # Errors
/// Those of `out`. Values are not checked; [`write_obj`] checks them.
pub fn write_obj_to(out: &mut impl Write, mesh: ObjMesh<'_>) -> io::Result<()> {
    rows(out, "v", mesh.positions.iter().map(Vec3::to_array))?;
    rows(out, "vt", mesh.texcoords.iter().map(Vec2::to_array))?;
    rows(out, "vn", mesh.normals.iter().map(Vec3::to_array))?;
    for face in mesh.faces.iter() {
        out.write_all(b"f")?;
        for corner in face {
            // OBJ counts from 1; a normal has the number of its position.
            let v = u64::from(corner.position) + 1;
            match (corner.texcoord, mesh.normals.is_empty()) {
                (Some(t), false) => write!(out, " {v}/{}/{v}", u64::from(t) + 1)?,
                (Some(t), true) => write!(out, " {v}/{}", u64::from(t) + 1)?,
                (None, false) => write!(out, " {v}//{v}")?,
                (None, true) => write!(out, " {v}")?,
            }
        }
        out.write_all(b"\n")?;
    }
    Ok(())
}

fn rows<const N: usize>(out: &mut impl Write, keyword: &str, rows: impl Iterator<Item = [f32; N]>) -> io::Result<()> {
    let mut line = String::new();
    for row in rows {
        line.clear();
        line.push_str(keyword);
        for x in row {
            line.push(' ');
            push_nine_digits(&mut line, x);
        }
        line.push('\n');
        out.write_all(line.as_bytes())?;
    }
    Ok(())
}

/// Appends `x` as a plain decimal of nine significant digits, without trailing zeros.
fn push_nine_digits(text: &mut String, x: f32) {
    use std::fmt::Write;
    // One decimal too many does no harm, so the logarithm need not be exact.
    let decimals = (8.0 - f64::from(x.abs()).log10().floor().clamp(-45.0, 8.0)) as usize;
    let start = text.len();
    // Writing to a String cannot fail.
    let _ = write!(text, "{x:.decimals$}");
    if text[start..].contains('.') {
        text.truncate(text.trim_end_matches('0').trim_end_matches('.').len());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_finite_number_reads_back() {
        // Some of every exponent.
        for x in (0..=u32::MAX).step_by(65_521).map(f32::from_bits).filter(|x| x.is_finite()) {
            let mut text = String::new();
            push_nine_digits(&mut text, x);
            assert_eq!(text.parse::<f32>().unwrap().to_bits(), x.to_bits(), "{text}");
            assert!(!text.contains('e'));
        }
    }
}
