//! From OBJ text to arrays, through tobj, in the file's order.

use super::{ObjFile, scan};
use crate::asset::{Corner, Faces};
use crate::error::{Error, Result};
use crate::io::read_bounded;
use glam::{Vec2, Vec3};
use std::io::Read;
use std::path::Path;

/// The largest file that is read: an OBJ is held in memory, and its arrays take a few times its size.
const MAX_BYTES: u64 = 1 << 30;

impl ObjFile {
    /// Read one OBJ file.
    ///
    /// Polygons stay polygons, vertices stay in file order, and vertices without a face are kept. Points and
    /// lines (`p`, `l`), vertex colours, free-form surfaces, groups and materials are ignored. Lines end in LF or
    /// CR LF, or all of them in CR.
    ///
    /// # Errors
    /// [`Error::Io`] where the file cannot be read, [`Error::Input`] with the line where its text cannot be used, or where
    /// it is larger than 1 GiB.
    pub fn read(path: &Path) -> Result<Self> {
        Self::from_bytes(path, read_bounded(path, MAX_BYTES, "split the mesh")?)
    }

    /// The same, from text in memory; `path` is only for messages.
    ///
    /// # Errors
    /// [`Error::Input`], as [`read`](Self::read).
    pub fn from_bytes(path: &Path, bytes: Vec<u8>) -> Result<Self> {
        let scan = scan::scan(path, bytes)?;
        let head = ordering_face(scan.counts);
        let first = scan.counts.into_iter().max().unwrap_or(0);

        let mut reader = head.as_bytes().chain(scan.text.as_slice());
        let loaded = tobj::load_obj_buf(&mut reader, &tobj::LoadOptions::default(), |_| {
            Ok((Vec::new(), std::collections::HashMap::new()))
        });
        drop((head, scan.text));
        // The scan has refused what tobj refuses; a difference between the two would end up here.
        let refuse = |what: String| Error::input(path, "", what, "export the file again, with one statement on a line");
        let (mut models, _) = loaded.map_err(|e| refuse(e.to_string()))?;
        let mesh = models.pop().map(|model| model.mesh).unwrap_or_default();
        let complete = models.is_empty()
            && mesh.positions.len() == 3 * scan.counts[0]
            && mesh.texcoords.len() == 2 * scan.counts[1]
            && mesh.normals.len() == 3 * scan.counts[2]
            && mesh.indices.len() == first + scan.corners;
        if !complete {
            return Err(refuse("the parser lost vertices or corners".into()));
        }

        // tobj leaves the sizes out when all faces, the first one included, are triangles.
        let sizes = match mesh.face_arities.split_first() {
            Some((_, sizes)) => sizes.to_vec(),
            None => vec![3; scan.corners / 3],
        };
        let has_texcoords = !mesh.texcoord_indices.is_empty();
        let mut corners: Vec<Corner> = mesh.indices[first..]
            .iter()
            .enumerate()
            .map(|(i, &position)| Corner {
                position,
                texcoord: has_texcoords.then(|| mesh.texcoord_indices[first + i]),
            })
            .collect();
        // For a corner without one, tobj repeats the corner before.
        for &i in &scan.without_texcoord {
            corners[i as usize].texcoord = None;
        }
        let named = scan.corners - scan.without_normal;
        Ok(Self {
            positions: mesh.positions.chunks_exact(3).map(Vec3::from_slice).collect(),
            texcoords: mesh.texcoords.chunks_exact(2).map(Vec2::from_slice).collect(),
            normals: mesh.normals.chunks_exact(3).map(Vec3::from_slice).collect(),
            corner_normals: (named > 0 && scan.without_normal == 0).then(|| mesh.normal_indices[first..].to_vec()),
            any_normals: named > 0,
            faces: Faces { sizes, corners },
        })
    }
}

/// A face whose corners name every vertex, texture coordinate and normal in file order.
///
/// tobj numbers all three by first use and drops what no face uses. As the first face of the file, this one
/// makes the order of first use the order of the file. It is cut off again after parsing.
fn ordering_face(counts: [usize; 3]) -> String {
    use std::fmt::Write;
    let corners = counts.into_iter().max().unwrap_or(0);
    let mut line = String::with_capacity(corners * 24 + 2);
    line.push('f');
    for i in 1..=corners {
        let [v, vt, vn] = counts.map(|n| i.min(n));
        // Writing to a String cannot fail.
        let _ = match (vt, vn) {
            (0, 0) => write!(line, " {v}"),
            (_, 0) => write!(line, " {v}/{vt}"),
            (0, _) => write!(line, " {v}//{vn}"),
            _ => write!(line, " {v}/{vt}/{vn}"),
        };
    }
    line.push('\n');
    line
}
