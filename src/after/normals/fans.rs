//! The triangles around each vertex, in pose-buffer order.

use crate::abi::numbers::PIECE;
use crate::after::pieces::Pieces;
use crate::asset::{Faces, check_welds};
use crate::error::{Error, Result};
use crate::pack::PackedMesh;

/// Maps a vertex to the first one welded to it.
///
/// # Errors
/// Faces or welds that do not match `vertices` vertices.
pub(super) fn first_of<'a>(
    faces: &Faces,
    welds: &'a [u32],
    vertices: usize,
) -> Result<impl Fn(u32) -> u32 + Copy + use<'a>> {
    faces.check(vertices, usize::MAX)?;
    check_welds(welds, vertices).map_err(|what| Error::invalid(what, "pass the welds of this mesh"))?;
    Ok(move |v: u32| welds.get(v as usize).copied().unwrap_or(v))
}

/// Input of `normals.comp` after the base pose, and the dependencies between pieces.
pub(super) struct Fans {
    /// By vertex, padding included: first word of its fan, counted from the base pose; then the fans.
    pub words: Vec<u32>,
    pub spread: Spread,
}

/// By piece: the pieces whose normals depend on its positions, as concatenated lists.
#[derive(Clone, Debug)]
pub(in crate::after) struct Spread {
    ends: Vec<u32>,
    pieces: Vec<u32>,
}

impl Fans {
    /// `check` is called with the number of words before they are allocated; each corner of a polygon has a fan.
    pub fn new(mesh: &PackedMesh, check: impl FnOnce(u64) -> Result<()>) -> Result<Self> {
        let (layout, faces) = (mesh.layout(), &mesh.faces);
        let of = first_of(faces, &mesh.welds, layout.vertex_count)?;
        let pairs = faces.iter().map(|face| face.len() as u64 * (face.len() as u64 - 2));
        let fans = (0..layout.vertex_count as u32).filter(|v| of(*v) == *v).count();
        check((layout.padded_vertices() + 2 * fans) as u64 + 2 * pairs.sum::<u64>())?;
        // Pose-buffer indices of vertices.
        let mut packed: Vec<u32> = (0..layout.vertex_count as u32).collect();
        layout.remap_indices(&mut packed)?;
        let mut around: Vec<Vec<[u32; 2]>> = vec![vec![]; layout.vertex_count];
        for face in faces.iter() {
            // Welded vertices share the first one's position. A polygon's area is that of the fan from any corner.
            let corner = |i: usize| of(face[i % face.len()].position) as usize;
            for at in 0..face.len() {
                let fan = (at + 1..at + face.len() - 1).map(|i| [packed[corner(i)], packed[corner(i + 1)]]);
                around[corner(at)].extend(fan);
            }
        }
        let fans_at = layout.base_bytes() as usize / 4;
        let mut words = vec![0; layout.padded_vertices()];
        let mut places = vec![0; layout.vertex_count];
        for (first, fan) in around.iter().enumerate().filter(|(v, _)| of(*v as u32) as usize == *v) {
            places[first] = (fans_at + words.len()) as u32;
            words.extend([fan.len() as u32, packed[first]]);
            words.extend(fan.as_flattened());
        }
        let pieces = layout.vertex_count.div_ceil(PIECE as usize);
        let mut dependents: Vec<Vec<u32>> = vec![vec![]; pieces];
        for (user, &at) in packed.iter().enumerate() {
            let first = of(user as u32) as usize;
            words[at as usize] = places[first];
            let reads = around[first].as_flattened().iter().chain([&packed[first]]);
            for read in reads {
                let reader = at / PIECE;
                let of_read = &mut dependents[(read / PIECE) as usize];
                if of_read.last() != Some(&reader) {
                    of_read.push(reader);
                }
            }
        }
        let mut spread = Spread { ends: vec![], pieces: vec![] };
        for of_piece in &mut dependents {
            of_piece.sort_unstable();
            of_piece.dedup();
            spread.pieces.append(of_piece);
            spread.ends.push(spread.pieces.len() as u32);
        }
        Ok(Self { words, spread })
    }
}

impl Spread {
    /// Adds to `normals` the pieces that depend on `moved`.
    pub fn of(&self, moved: &Pieces, normals: &mut Pieces) {
        for piece in moved.iter() {
            let first = piece.checked_sub(1).map_or(0, |before| self.ends[before as usize]);
            let list = &self.pieces[first as usize..self.ends[piece as usize] as usize];
            list.iter().for_each(|piece| normals.add(*piece..piece + 1));
        }
    }
}
