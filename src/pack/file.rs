//! Packed assets on disk: `.dmorph` files, which are loaded without packing again.
//!
//! Numbers are little-endian. A file is a header, a table of sections, and the sections in the table's order, each
//! padded with zeros to a multiple of 8 bytes; nothing lies between them or after the last.
//!
//! ```text
//! header    magic "DMORPH\r\n"   version u32 = 2   sections u32
//! table     [section][id u32, checksum u32, offset u64, length u64]
//!           checksum of header and table u32   zero u32
//!
//! id  section             contents
//!  1  meta                format u32 (1 block-float32, 2 fast, 3 small)   block size u32   vertices u32   targets u32
//!                         blocks u32   entries u32   words u32   faces u32   corners u32   texcoords u32
//!                         position step f32   normal step f32   diagonal f32   weight max f32
//!                         position tolerance f32   normal tolerance f32
//!                         largest position error f64   largest normal error in degrees f64
//!  2  names               of the mesh, then of each target: length in bytes u32, UTF-8
//!  3  base pose           [packed vertex][px py pz nx ny nz] f32, without padding
//!  4  order               [packed vertex] the user's vertex u32
//!  5  first entries       [block + 1] u32
//!  6  entry targets       [entry] u32
//!  7  words               [word] u32: headers and deltas, see blocks
//!  8  face sizes          [face] u32
//!  9  face corners        [corner] the user's vertex u32
//! 10  corner texcoords    [corner] u32, 0xffffffff where there is none; empty where no corner has one
//! 11  texcoords           [texcoord][u v] f32
//! ```
//!
//! Checksums are CRC-32 (the one of zlib). Whatever a file says, reading takes a small multiple of its size in memory:
//! counts are held against the lengths of sections, and those against the file, before anything is made of them. What
//! planning needs besides ([`BlockIndex`]) is derived, and its rules are checked on the way.

mod read;
mod table;
mod write;

use super::blocks::BlockIndex;
use super::{DeltaFormat, PackDesc, PackedLayout, PackedMesh};
use crate::error::{Error, Result};
use crate::io::{read_bounded, write_replacing};
use crate::mesh::{Faces, MorphMesh, MorphTarget, Tolerance};
use glam::{Vec2, Vec3};
use std::io::Write;
use std::path::Path;

/// Larger files are not read.
const MAX_BYTES: u64 = 4 << 30;

/// A mesh packed into blocks, and what else an OBJ file of it needs.
#[derive(Clone, Debug, PartialEq)]
pub struct Asset {
    /// The mesh, in a block format.
    pub mesh: PackedMesh,
    /// The face list, which names the user's vertices.
    pub faces: Faces,
    /// Texture coordinates, as the faces index them.
    pub texcoords: Vec<Vec2>,
    /// The tolerance that deltas were kept by before they were packed.
    pub tolerance: Tolerance,
}

impl Asset {
    /// Pack `mesh` as `desc` says.
    ///
    /// # Errors
    /// A dense format; what [`PackedMesh::pack`] refuses.
    pub fn pack(mesh: &MorphMesh, desc: &PackDesc) -> Result<Self> {
        refuse_dense(desc.format)?;
        Ok(Self {
            mesh: PackedMesh::pack(mesh, desc)?,
            faces: mesh.faces.clone(),
            texcoords: mesh.texcoords.clone(),
            tolerance: mesh.tolerance,
        })
    }

    /// Read the file `path`.
    ///
    /// # Errors
    /// [`Error::Io`] where the file cannot be read, [`Error::Input`] with the section where what it says cannot be
    /// used, or where it is larger than 4 GiB.
    pub fn read(path: &Path) -> Result<Self> {
        read::asset(path, &read_bounded(path, MAX_BYTES, "split the mesh")?)
    }

    /// The same, from bytes in memory; `path` is only for messages.
    ///
    /// # Errors
    /// [`Error::Input`], as [`read`](Self::read).
    pub fn from_bytes(path: &Path, bytes: &[u8]) -> Result<Self> {
        read::asset(path, bytes)
    }

    /// Write the file `path`, in place of what is there once all is written.
    ///
    /// # Errors
    /// [`Error::Io`] where the file cannot be written, else as [`to_bytes`](Self::to_bytes).
    pub fn write(&self, path: &Path) -> Result<()> {
        let bytes = self.to_bytes()?;
        write_replacing(path, |out| out.write_all(&bytes))
    }

    /// What [`write`](Self::write) writes.
    ///
    /// # Errors
    /// [`Error::Invalid`]: a dense format; a mesh without vertices; faces, texture coordinates, a tolerance or names
    /// that a mesh may not have; more than a file can hold.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        self.check().map_err(|what| {
            Error::invalid(
                format!("mesh '{}' cannot be written as .dmorph: {what}", self.mesh.layout().name),
                "write a mesh that to_mesh() has accepted",
            )
        })?;
        write::bytes(self, self.blocks()?)
    }

    /// The mesh as it decodes, in the user's order of vertices: for dense formats, and for the reference.
    ///
    /// # Errors
    /// A dense format.
    pub fn to_mesh(&self) -> Result<MorphMesh> {
        self.blocks()?;
        let layout = self.mesh.layout();
        let base = layout.to_user_order(self.mesh.base());
        let vertices = || base.chunks_exact(super::POSE_FLOATS);
        Ok(MorphMesh {
            name: layout.name.clone(),
            positions: vertices().map(|v| Vec3::from_slice(&v[..3])).collect(),
            normals: vertices().map(|v| Vec3::from_slice(&v[3..])).collect(),
            texcoords: self.texcoords.clone(),
            faces: self.faces.clone(),
            targets: (0..layout.targets.len()).map(|t| self.target(t)).collect(),
            diagonal: layout.diagonal,
            tolerance: self.tolerance,
            ..MorphMesh::default()
        })
    }

    /// Target `at` as it decodes; blocks hold zeros where nothing moves.
    fn target(&self, at: usize) -> MorphTarget {
        let mut deltas = vec![];
        self.mesh.for_each_delta(at, |vertex, delta| {
            let delta = delta.map(|d| d as f32);
            if delta.iter().any(|d| *d != 0.0) {
                deltas.push((vertex as u32, delta));
            }
        });
        deltas.sort_unstable_by_key(|(vertex, _)| *vertex);
        MorphTarget {
            name: self.mesh.layout().targets[at].name.clone(),
            vertices: deltas.iter().map(|(vertex, _)| *vertex).collect(),
            positions: deltas.iter().map(|(_, d)| Vec3::from_slice(&d[..3])).collect(),
            normals: deltas.iter().map(|(_, d)| Vec3::from_slice(&d[3..])).collect(),
            streams: vec![],
        }
    }

    fn blocks(&self) -> Result<&BlockIndex> {
        let layout: &PackedLayout = self.mesh.layout();
        refuse_dense(layout.format)?;
        layout.blocks.as_deref().ok_or_else(|| Error::invalid("a mesh without blocks", "pack it"))
    }

    /// What neither packing nor the layout of a file sees to.
    fn check(&self) -> Result<(), String> {
        let layout = self.mesh.layout();
        if layout.vertex_count == 0 {
            return Err("it has no vertex".into());
        }
        if !(layout.diagonal.is_finite() && layout.diagonal >= 0.0) {
            return Err(format!("a diagonal of {}", layout.diagonal));
        }
        let Tolerance { position, normal } = self.tolerance;
        if [position, normal].iter().any(|t| !(t.is_finite() && *t >= 0.0)) {
            return Err(format!("tolerances of {position} and {normal}"));
        }
        if let Some(i) = self.texcoords.iter().position(|t| !t.is_finite()) {
            return Err(format!("texture coordinate {i} is {}", self.texcoords[i]));
        }
        self.faces.check(layout.vertex_count, self.texcoords.len()).map_err(|e| match e {
            Error::Invalid { what, .. } => what,
            other => other.to_string(),
        })?;
        let mut names: Vec<&str> = layout.targets.iter().map(|t| t.name.as_str()).collect();
        names.sort_unstable();
        match names.windows(2).find(|w| w[0] == w[1]) {
            Some(twice) => Err(format!("two targets are called '{}'", twice[0])),
            None => Ok(()),
        }
    }
}

fn refuse_dense(format: DeltaFormat) -> Result<()> {
    match format.is_blocks() {
        true => Ok(()),
        false => Err(Error::invalid(
            format!("the dense format '{}' in a packed file", format.name()),
            "pack as 'fast' or 'small'",
        )),
    }
}

#[cfg(test)]
mod tests;
