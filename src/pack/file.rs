//! Packed meshes as files (`.dmorph`), which load without packing.
//!
//! Numbers are little-endian. A file is a header, a table of sections, and the sections in the table's order, each
//! padded with zeros to a multiple of 8 bytes, without gaps.
//!
//! ```text
//! header    magic "DMORPH\r\n"   version u32 = 6, or 7 with clips   sections u32
//! table     [section][id u32, checksum u32, offset u64, length u64]
//!           checksum of header and table u32   zero u32
//!
//! id  section             contents
//!  1  meta                format u32 (the ids of src/abi/formats.rs)   block size u32   vertices u32   targets u32
//!                         faces u32   corners u32   texcoords u32
//!                         diagonal f32   weight max f32   position tolerance f32   normal tolerance f32
//!  2  names               of the mesh, then of each target: length in bytes u32, UTF-8
//!  4  order               [packed vertex] the user's vertex u32
//!  8  face sizes          [face] u32
//!  9  face corners        [corner] the user's vertex u32
//! 10  corner texcoords    [corner] u32, 0xffffffff: none; empty if no corner has one
//! 11  texcoords           [texcoord][u v] f32
//! 13  welds               [user's vertex] the first vertex at its position (or itself) u32; empty if none is welded
//! 14  clips               version 7: weight clips, see src/pack/file/clips.rs
//!
//! then for each group g of streams, with 256 g added to the id:
//! 12  group               streams u32   blocks u32   entries u32   words u32   steps of both triples f32 f32
//!                         [stream][id u32, zero u32, largest error f64]
//!                         (1 position, 2 normal, 3 tangent, 4 + 256 set texture coordinates, 5 + 256 set colours,
//!                         6 masks; errors in input units, degrees, degrees, and absolute)
//!  3  base pose           [packed vertex][six f32], without padding; positions as in the input, even if recentred
//!  5  first entries       [block + 1] u32
//!  6  entry targets       [entry] u16
//!  7  words               [word] u32: headers and deltas, see blocks
//! ```
//!
//! Checksums are CRC-32 (as in zlib). Reading any file takes at most 24 times its size in memory for each group of
//! streams (at most 16), plus 16 KiB: counts are checked against section lengths, and those against the file, before
//! anything is allocated. Data that planning needs ([`BlockIndex`](super::blocks::BlockIndex)) is derived on reading,
//! and its invariants are checked.

mod clips;
mod contents;
mod table;

use super::source::sort;
use super::{POSE_FLOATS, PackedGroup, PackedMesh, PackedTarget};
use crate::asset::{KeptMesh, KeptTarget, Semantic, Tolerance, check_welds};
use crate::error::{Error, Result, ensure};
use crate::io::{read_bounded, write_replacing};
use crate::weights::WeightClip;
use std::io::Write;
use std::path::Path;

const MAX_BYTES: u64 = 4 << 30;

/// The bytes of a file.
pub(crate) fn bytes(path: &Path) -> Result<Vec<u8>> {
    read_bounded(path, MAX_BYTES, "split the mesh")
}

/// The clips of a file, of which nothing else is read.
pub(crate) fn clips(path: &Path, bytes: &[u8]) -> Result<Vec<WeightClip>> {
    contents::clips_of(path, &table::split(path, bytes)?)
}

impl PackedMesh {
    /// Reads the file `path`.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be read; [`Error::Input`], naming the section, if it is invalid or larger than
    /// 4 GiB. Clips that are damaged are left out, with a note.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        contents::read(path, &bytes(path)?)
    }

    /// Reads a file from memory; `path` is used only in messages.
    ///
    /// # Errors
    /// [`Error::Input`], naming the section, if `bytes` are invalid.
    pub fn from_bytes(path: impl AsRef<Path>, bytes: &[u8]) -> Result<Self> {
        contents::read(path.as_ref(), bytes)
    }

    /// Writes the file `path`. An existing file is replaced once all bytes are written.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be written, and the errors of [`to_bytes`](Self::to_bytes).
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        let bytes = self.to_bytes()?;
        write_replacing(path.as_ref(), |out| out.write_all(&bytes))
    }

    /// The bytes of the file that [`write`](Self::write) writes.
    ///
    /// # Errors
    /// [`Error::Invalid`]: a dense format; no vertices; invalid faces, texture coordinates, welds, tolerance or names;
    /// a clip that [`WeightClip::bind`] refuses whatever the targets are called, or that has no positive frame rate;
    /// more data than a file can hold.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        self.check().map_err(|what| {
            let what = format!("mesh '{}' cannot be written as .dmorph: {what}", self.layout().name);
            Error::invalid(what, "write a mesh as it was packed or read")
        })?;
        contents::write(self)
    }

    /// Decodes the mesh, in the user's vertex order: to pack it in a dense format, or for the reference.
    ///
    /// # Errors
    /// A dense format.
    #[doc(hidden)]
    pub fn unpack(&self) -> Result<KeptMesh> {
        let layout = self.layout();
        layout.index()?;
        let target = |target: &PackedTarget| KeptTarget { name: target.name.clone(), ..Default::default() };
        let mut mesh = KeptMesh {
            name: layout.name.clone(),
            texcoords: self.texcoords.clone(),
            faces: self.faces.clone(),
            welds: self.welds.clone(),
            targets: layout.targets.iter().map(target).collect(),
            diagonal: layout.diagonal,
            origin: layout.origin,
            tolerance: self.tolerance,
            notes: self.notes.clone(),
            ..Default::default()
        };
        self.groups.iter().for_each(|group| unpack(group, &mut mesh));
        Ok(mesh)
    }

    /// Checks that neither packing nor the file format makes.
    fn check(&self) -> Result<(), String> {
        let layout = self.layout();
        let is_size = |size: &f32| size.is_finite() && *size >= 0.0;
        ensure!(layout.vertex_count > 0, "it has no vertex".into());
        ensure!(is_size(&layout.diagonal), format!("a diagonal of {}", layout.diagonal));
        let Tolerance { position, normal } = self.tolerance;
        ensure!([position, normal].iter().all(is_size), format!("tolerances of {position} and {normal}"));
        for (i, texcoord) in self.texcoords.iter().enumerate() {
            ensure!(texcoord.is_finite(), format!("texture coordinate {i} is {texcoord}"));
        }
        check_welds(&self.welds, layout.vertex_count)?;
        self.faces
            .check(layout.vertex_count, self.texcoords.len())
            .map_err(|e| if let Error::Invalid { what, .. } = &e { what.clone() } else { e.to_string() })?;
        let mut names: Vec<&str> = layout.targets.iter().map(|t| t.name.as_str()).collect();
        names.sort_unstable();
        let twice = names.windows(2).find(|w| w[0] == w[1]);
        twice.map_or(Ok(()), |twice| Err(format!("two targets are called '{}'", twice[0])))
    }
}

/// Appends a decoded group to `mesh`, whose targets exist.
fn unpack(group: &PackedGroup, mesh: &mut KeptMesh) {
    let layout = group.layout();
    let base = layout.to_user_order(group.base());
    for place in &layout.streams {
        let values = base.chunks_exact(POSE_FLOATS).flat_map(|v| &v[place.components()]).copied().collect();
        mesh.push(place.semantic, values);
    }
    for (at, target) in mesh.targets.iter_mut().enumerate() {
        let mut lanes = vec![];
        group.for_each_delta(at, |vertex, delta| lanes.push((vertex as u32, delta.map(|d| d as f32))));
        sort(&mut lanes);
        for place in &layout.streams {
            let numbers = place.morphing_components();
            // Blocks contain zero deltas. Positions and normals share one list of vertices.
            let surface = matches!(place.semantic, Semantic::Position | Semantic::Normal);
            let listed = if surface { 0..POSE_FLOATS } else { numbers.clone() };
            let moved = lanes.iter().filter(|(_, delta)| delta[listed.clone()].iter().any(|d| *d != 0.0));
            let vertices = moved.clone().map(|(vertex, _)| *vertex).collect();
            let deltas = moved.flat_map(|(_, delta)| &delta[numbers.clone()]).copied().collect();
            target.push(place.semantic, vertices, deltas);
        }
    }
}

#[cfg(test)]
mod tests;
