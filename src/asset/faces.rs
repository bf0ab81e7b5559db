//! Faces: polygons over vertices and texture coordinates.

use crate::error::{Error, Result};

/// One corner of a face: indices into positions and texture coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Corner {
    /// Index into the positions.
    pub position: u32,
    /// Index into the texture coordinates, where the face has them.
    pub texcoord: Option<u32>,
}

/// The face list: polygons of any size, as the file has them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Faces {
    /// Number of corners of each face (≥ 3).
    pub sizes: Vec<u32>,
    /// The corners of all faces, one after the other.
    pub corners: Vec<Corner>,
}

impl Faces {
    /// The faces, each as its corners.
    pub fn iter(&self) -> impl Iterator<Item = &[Corner]> {
        let mut rest = self.corners.as_slice();
        self.sizes.iter().map(move |&n| {
            let (face, tail) = rest.split_at(n as usize);
            rest = tail;
            face
        })
    }

    /// Position indices of the faces cut into triangle fans.
    pub fn triangles(&self) -> Vec<[u32; 3]> {
        self.iter().flat_map(|f| f.windows(2).skip(1).map(|w| [f[0].position, w[0].position, w[1].position])).collect()
    }

    /// Whether every face has three corners or more, and every index is within `positions` and `texcoords`.
    pub(crate) fn check(&self, positions: usize, texcoords: usize) -> Result<()> {
        let refuse = |what: String| Err(Error::invalid(what, "repair the face list"));
        let total: u64 = self.sizes.iter().map(|&n| u64::from(n)).sum();
        if total != self.corners.len() as u64 {
            return refuse(format!("the faces have {total} corners, the corner list has {}", self.corners.len()));
        }
        if let Some(i) = self.sizes.iter().position(|&n| n < 3) {
            return refuse(format!("face {i} has {} corners, at least 3 expected", self.sizes[i]));
        }
        for c in &self.corners {
            if c.position as usize >= positions {
                return refuse(format!("a face names vertex {}, there are {positions}", c.position));
            }
            if let Some(t) = c.texcoord.filter(|&t| t as usize >= texcoords) {
                return refuse(format!("a face names texture coordinate {t}, there are {texcoords}"));
            }
        }
        Ok(())
    }
}
