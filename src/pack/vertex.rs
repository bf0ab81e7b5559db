//! Interleaved vertices of the host that poses are written into.

use super::{POSE_FLOATS, PackedLayout, PoseFormat};
use crate::abi::kernels::OFFSETS;
use crate::asset::streams::{Semantic, StreamPlace};
use crate::error::{Error, Result, ensure};
use std::fmt;

/// Most streams per vertex: the vertex attributes that every device supports.
const STREAMS_MAX: usize = 16;

/// Layout of the host's interleaved vertices, for poses written into them ([`HostPoses`](crate::HostPoses) names the
/// buffer).
///
/// Position, normal and tangent in a vertex of 48 bytes, with texture coordinates at offset 40:
/// ```
/// # use deltamorph::{Semantic, VertexLayout};
/// let vertex = VertexLayout::new(48)
///     .stream(Semantic::Position, 0)
///     .stream(Semantic::Normal, 12)
///     .stream(Semantic::Tangent, 24);
/// # assert_eq!(vertex.offset(Semantic::Tangent), Some(24));
/// ```
///
/// A stream has as many consecutive numbers as [components](Semantic::components), each in the crowd's [`PoseFormat`].
/// Streams that are not listed and bytes between streams are never written. Positions are required. With `fixed16`, a
/// stream includes all six components of its group (such as position and
/// normal), which stay together: 12 bytes from the first stream on.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct VertexLayout {
    stride: u32,
    streams: [(Semantic, u32); STREAMS_MAX],
    /// Streams listed; more than `STREAMS_MAX` is an error of `check`.
    count: usize,
}

impl VertexLayout {
    /// A vertex of `stride` bytes (a multiple of 4), without streams.
    #[must_use]
    pub const fn new(stride: u32) -> Self {
        Self { stride, streams: [(Semantic::Position, 0); STREAMS_MAX], count: 0 }
    }

    /// Adds a stream at `offset` bytes from the start of a vertex, a multiple of 4 (`fixed16`: of 2), or moves it if it
    /// is listed already. At most 16 streams.
    #[must_use]
    pub fn stream(mut self, semantic: Semantic, offset: u32) -> Self {
        let named = self.streams().position(|(named, _)| named.id() == semantic.id());
        if let Some(place) = self.streams.get_mut(named.unwrap_or(self.count)) {
            *place = (semantic, offset);
        }
        self.count += usize::from(named.is_none());
        self
    }

    /// Bytes per vertex.
    #[doc(hidden)]
    pub const fn stride(&self) -> u32 {
        self.stride
    }

    /// Byte offset of a stream; `None` if it is not listed.
    #[doc(hidden)]
    pub fn offset(&self, semantic: Semantic) -> Option<u32> {
        self.streams().find(|(named, _)| named.id() == semantic.id()).map(|(_, offset)| offset)
    }

    /// The streams and their byte offsets.
    pub(crate) fn streams(&self) -> impl Iterator<Item = (Semantic, u32)> {
        self.streams.into_iter().take(self.count)
    }

    /// Bytes of a pose, padded like engine-owned poses ([`padded_vertices`](PackedLayout::padded_vertices)). A crowd
    /// takes this for each slot of each instance.
    pub fn pose_bytes(&self, layout: &PackedLayout) -> u64 {
        layout.padded_vertices() as u64 * u64::from(self.stride)
    }

    /// Checks the layout against the groups of a mesh and a pose format.
    ///
    /// # Errors
    /// More than 16 streams; a misaligned stride or offset; overlapping streams; a stream beyond the stride, or that
    /// the mesh lacks; no positions; `fixed16`: the streams of a group apart.
    pub(crate) fn check<'a>(
        &self,
        groups: impl Iterator<Item = &'a PackedLayout> + Clone,
        format: PoseFormat,
    ) -> Result<()> {
        let stride = self.stride;
        let refuse =
            |what: String, remedy: &str| Error::invalid(format!("poses in vertices of {stride} bytes: {what}"), remedy);
        ensure!(self.count <= STREAMS_MAX, refuse(format!("{} streams", self.count), "use at most 16"));
        ensure!(stride > 0 && stride.is_multiple_of(4), refuse("the stride".into(), "use a multiple of 4 from 4 on"));
        let number = format.number_bytes() as u32;
        let remedy = format!("use multiples of {number}");
        for (semantic, offset) in self.streams() {
            ensure!(offset.is_multiple_of(number), refuse(format!("stream '{semantic}' at {offset}"), &remedy));
        }
        let has_positions = self.offset(Semantic::Position).is_some();
        ensure!(has_positions, refuse("no positions".into(), "add Semantic::Position with its offset"));
        for (semantic, _) in self.streams() {
            let is_there = groups.clone().flat_map(|group| &group.streams).any(|place| place.semantic == semantic);
            let what = format!("stream '{semantic}', which the mesh does not have");
            ensure!(is_there, refuse(what, "leave it out"));
        }
        // Written bytes of a vertex: begin, end, stream.
        let mut written: Vec<(u64, u64, Semantic)> = vec![];
        for group in groups {
            let mut named = group.streams.iter().filter_map(|place| Some((place, self.offset(place.semantic)?)));
            if !format.shares_words() {
                let end = |place: &StreamPlace, at| u64::from(at) + 4 * place.components().len() as u64;
                written.extend(named.map(|(place, at)| (at.into(), end(place, at), place.semantic)));
                continue;
            }
            let Some((first, at)) = named.clone().next() else { continue };
            let begin = i64::from(at) - format.offset(first.first) as i64;
            let is_apart = |place: &StreamPlace, at| begin + format.offset(place.first) as i64 != i64::from(at);
            if let Some((place, at)) = named.find(|(place, at)| begin < 0 || begin % 4 != 0 || is_apart(place, *at)) {
                let what = format!("stream '{}' at {at} in {} poses", place.semantic, format.name());
                return Err(refuse(what, "keep the streams of a group together in 12 bytes, from a multiple of 4 on"));
            }
            written.push((begin as u64, begin as u64 + format.stride() as u64, first.semantic));
        }
        written.sort_unstable();
        let next = |i: usize| written.get(i + 1).map_or(u64::from(stride), |(begin, ..)| *begin);
        if let Some((i, (begin, end, semantic))) = written.iter().enumerate().find(|(i, (_, end, _))| *end > next(*i)) {
            let behind = written.get(i + 1).map_or("the end of the vertex".into(), |(.., after)| format!("'{after}'"));
            let what = format!("stream '{semantic}' takes bytes {begin} to {end}, beyond the beginning of {behind}");
            return Err(refuse(what, "move it, or use a larger stride"));
        }
        Ok(())
    }

    /// Offsets of the components of a group; `check` has passed.
    pub(crate) fn offsets(&self, group: &PackedLayout, format: PoseFormat) -> VertexOffsets {
        let number = format.number_bytes() as u32;
        let mut at = [None; POSE_FLOATS];
        for place in &group.streams {
            let Some(offset) = self.offset(place.semantic) else { continue };
            for component in place.components() {
                at[component] = Some(offset / number + (component - place.first) as u32);
            }
            if format.shares_words() {
                let first = (offset as usize - format.offset(place.first)) as u32 / number;
                at = std::array::from_fn(|component| Some(first + component as u32));
            }
        }
        VertexOffsets { stride: self.stride / number, at }
    }
}

impl fmt::Debug for VertexLayout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let streams: Vec<_> = self.streams().collect();
        f.debug_struct("VertexLayout").field("stride", &self.stride).field("streams", &streams).finish()
    }
}

/// Values of `glsl/vertex_offsets.glsl`'s specialization constants.
pub(crate) type OffsetConstants = [u32; OFFSETS];

/// Offsets of the six components of a vertex in a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct VertexOffsets {
    /// Numbers per vertex.
    stride: u32,
    /// Offset in numbers; `None`: not stored.
    at: [Option<u32>; POSE_FLOATS],
}

impl VertexOffsets {
    /// Contiguous, as in engine-owned poses.
    pub const TIGHT: Self =
        Self { stride: POSE_FLOATS as u32, at: [Some(0), Some(1), Some(2), Some(3), Some(4), Some(5)] };

    /// The same, from a start `numbers` numbers earlier.
    pub fn shifted(self, numbers: u32) -> Self {
        Self { at: self.at.map(|at| Some(at? + numbers)), ..self }
    }

    /// Specialization constants of `glsl/vertex_offsets.glsl`; `None` if its defaults apply.
    pub fn constants(self) -> Option<OffsetConstants> {
        // Components that are not stored load from the offset of a stored one.
        let any = self.at.into_iter().flatten().next().unwrap_or(0);
        let stored = (0..).zip(self.at).map(|(i, at)| u32::from(at.is_some()) << i).sum();
        let [a, b, c, d, e, f] = self.at.map(|at| at.unwrap_or(any));
        (self != Self::TIGHT).then_some([self.stride, a, b, c, d, e, f, stored])
    }

    /// Bytes per vertex.
    pub fn stride(self, format: PoseFormat) -> u32 {
        self.stride * format.number_bytes() as u32
    }

    /// Byte offset of each component.
    pub fn bytes(self, format: PoseFormat) -> [Option<u32>; POSE_FLOATS] {
        self.at.map(|at| Some(at? * format.number_bytes() as u32))
    }
}
