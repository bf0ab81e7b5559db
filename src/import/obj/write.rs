//! OBJ export.

use crate::asset::{Faces, KeptMesh};
use bytemuck::cast_slice;
use glam::{Vec2, Vec3};
use std::io::{self, Write};

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

impl<'a> From<&'a KeptMesh> for ObjMesh<'a> {
    /// Takes the base pose.
    fn from(mesh: &'a KeptMesh) -> Self {
        Self { positions: &mesh.positions, normals: &mesh.normals, texcoords: &mesh.texcoords, faces: &mesh.faces }
    }
}

/// Writes `mesh` as OBJ text: `v`, `vt`, `vn` as decimals of the fewest digits that every `f32` reads back unchanged
/// from, then `f v/vt/vn`.
///
/// # Errors
/// Those of `out`.
pub fn write_obj(out: &mut impl Write, mesh: ObjMesh<'_>) -> io::Result<()> {
    rows(out, "v", 3, cast_slice(mesh.positions))?;
    rows(out, "vt", 2, cast_slice(mesh.texcoords))?;
    rows(out, "vn", 3, cast_slice(mesh.normals))?;
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

fn rows(out: &mut impl Write, keyword: &str, width: usize, numbers: &[f32]) -> io::Result<()> {
    for row in numbers.chunks_exact(width) {
        out.write_all(keyword.as_bytes())?;
        for x in row {
            write!(out, " {x}")?;
        }
        out.write_all(b"\n")?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_finite_number_reads_back() {
        // Some of every exponent.
        for x in (0..=u32::MAX).step_by(65_521).map(f32::from_bits).filter(|x| x.is_finite()) {
            let mut line = vec![];
            rows(&mut line, "v", 1, &[x]).unwrap();
            let text = str::from_utf8(&line).unwrap().strip_prefix("v ").unwrap().trim_end();
            assert_eq!(text.parse::<f32>().unwrap().to_bits(), x.to_bits(), "{text}");
            assert!(!text.contains('e'));
        }
    }
}
