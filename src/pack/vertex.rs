//! Vertices of a host's own, which poses are written into: where streams are, and what kernels are told of that.

use super::{POSE_FLOATS, PackedLayout, PoseFormat};
use crate::abi::kernels::PLACES;
use crate::asset::streams::{Semantic, StreamPlace};
use crate::error::{Error, Result};
use std::fmt;

/// Streams of a vertex, at most: as many attributes as every device fetches.
const STREAMS_MAX: usize = 16;

/// Where the streams of a pose are in an interleaved vertex of the host's own:
/// [`HostPoses`](crate::HostPoses) has the buffer.
///
/// Position, normal and tangent of a vertex of 48 bytes, which has texture coordinates at 40:
/// ```
/// # use deltamorph::{Semantic, VertexLayout};
/// let vertex = VertexLayout::new(48)
///     .stream(Semantic::Position, 0)
///     .stream(Semantic::Normal, 12)
///     .stream(Semantic::Tangent, 24);
/// # assert_eq!(vertex.offset(Semantic::Tangent), Some(24));
/// ```
///
/// A stream is as many numbers as it has [components](Semantic::components), one after the other, each as the crowd's
/// [`PoseFormat`] says. What lies between streams is the host's: nothing there is written. Streams of the mesh that are
/// not named are not written, either; positions have to be named. Of `fixed16` a stream brings the six numbers of its
/// group (position and normal, for example: [`PackedGroup`](crate::PackedGroup)), which stay together: 12 bytes, from
/// the first stream on.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct VertexLayout {
    stride: u32,
    streams: [(Semantic, u32); STREAMS_MAX],
    /// How many of `streams` there are; more were named where this is more.
    count: usize,
}

impl VertexLayout {
    /// A vertex of `stride` bytes, a multiple of 4, without streams.
    #[must_use]
    pub const fn new(stride: u32) -> Self {
        Self { stride, streams: [(Semantic::Position, 0); STREAMS_MAX], count: 0 }
    }

    /// The first number of a stream is `offset` bytes from the beginning of a vertex, a multiple of 4 (`fixed16`: of
    /// 2). At most 16 streams; named again, a stream moves.
    #[must_use]
    pub fn stream(mut self, semantic: Semantic, offset: u32) -> Self {
        let named = self.streams().position(|(named, _)| named.id() == semantic.id());
        if let Some(place) = self.streams.get_mut(named.unwrap_or(self.count)) {
            *place = (semantic, offset);
        }
        self.count += usize::from(named.is_none());
        self
    }

    /// Bytes from vertex to vertex.
    pub const fn stride(&self) -> u32 {
        self.stride
    }

    /// Bytes from the beginning of a vertex to a stream, where it is named.
    pub fn offset(&self, semantic: Semantic) -> Option<u32> {
        self.streams().find(|(named, _)| named.id() == semantic.id()).map(|(_, offset)| offset)
    }

    /// The streams, and where each begins.
    pub fn streams(&self) -> impl Iterator<Item = (Semantic, u32)> {
        self.streams.into_iter().take(self.count)
    }

    /// Bytes of a pose: vertices are padded as those of our own poses
    /// ([`padded_vertices`](PackedLayout::padded_vertices)). A crowd takes this for each slot of each instance.
    pub fn pose_bytes(&self, layout: &PackedLayout) -> u64 {
        layout.padded_vertices() as u64 * u64::from(self.stride)
    }

    /// Check it for the groups of a mesh and poses in a format.
    ///
    /// # Errors
    /// More than 16 streams; a stride or offset that is no multiple of words or numbers; streams that overlap, or do
    /// not fit the stride; one that the mesh does not have; no positions; of `fixed16`, a group whose streams are not
    /// together.
    pub(crate) fn check<'a>(
        &self,
        groups: impl Iterator<Item = &'a PackedLayout> + Clone,
        format: PoseFormat,
    ) -> Result<()> {
        let stride = self.stride;
        let refuse = |what: String, remedy: &str| {
            Err(Error::invalid(format!("poses in vertices of {stride} bytes: {what}"), remedy))
        };
        if self.count > STREAMS_MAX {
            return refuse(format!("{} streams", self.count), "name at most 16");
        }
        if stride == 0 || !stride.is_multiple_of(4) {
            return refuse("the stride".into(), "use a multiple of 4 from 4 on");
        }
        let number = format.number_bytes() as u32;
        if let Some((semantic, offset)) = self.streams().find(|(_, offset)| !offset.is_multiple_of(number)) {
            return refuse(format!("stream '{semantic}' at {offset}"), &format!("use multiples of {number}"));
        }
        if self.offset(Semantic::Position).is_none() {
            return refuse("no positions".into(), "name Semantic::Position, and where it is");
        }
        let has = |semantic| groups.clone().flat_map(|group| &group.streams).any(|place| place.semantic == semantic);
        if let Some((semantic, _)) = self.streams().find(|(semantic, _)| !has(*semantic)) {
            return refuse(format!("stream '{semantic}', which the mesh does not have"), "leave it out");
        }
        // What is written of a vertex: from where to where, and what for.
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
                return refuse(what, "keep the streams of a group together in 12 bytes, from a multiple of 4 on");
            }
            written.push((begin as u64, begin as u64 + format.stride() as u64, first.semantic));
        }
        written.sort_unstable();
        let next = |i: usize| written.get(i + 1).map_or(u64::from(stride), |(begin, ..)| *begin);
        if let Some((i, (begin, end, semantic))) = written.iter().enumerate().find(|(i, (_, end, _))| *end > next(*i)) {
            let behind = written.get(i + 1).map_or("the end of the vertex".into(), |(.., after)| format!("'{after}'"));
            let what = format!("stream '{semantic}' takes bytes {begin} to {end}, beyond the beginning of {behind}");
            return refuse(what, "move it, or use a larger stride");
        }
        Ok(())
    }

    /// Where the numbers of a group are, as [`check`](Self::check) has found them in order.
    pub(crate) fn places(&self, group: &PackedLayout, format: PoseFormat) -> Places {
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
        Places { stride: self.stride / number, at }
    }
}

impl fmt::Debug for VertexLayout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let streams: Vec<_> = self.streams().collect();
        f.debug_struct("VertexLayout").field("stride", &self.stride).field("streams", &streams).finish()
    }
}

/// Specialization constants of kernels.
pub(crate) type PlaceConstants = [u32; PLACES];

/// Where the six numbers of a vertex are in a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Places {
    /// Numbers from vertex to vertex.
    stride: u32,
    /// Numbers from the beginning of a vertex; `None`: not stored.
    at: [Option<u32>; POSE_FLOATS],
}

impl Places {
    /// One after the other, as in poses of ours.
    pub(crate) const TIGHT: Self =
        Self { stride: POSE_FLOATS as u32, at: [Some(0), Some(1), Some(2), Some(3), Some(4), Some(5)] };

    /// The same, counted from a place so many numbers before the vertex.
    pub(crate) fn behind(self, numbers: u32) -> Self {
        Self { at: self.at.map(|at| Some(at? + numbers)), ..self }
    }

    /// What `glsl/places.glsl` is specialized with; `None`: its defaults are right.
    pub(crate) fn constants(self) -> Option<PlaceConstants> {
        // What is not stored is loaded from the place of something that is.
        let any = self.at.into_iter().flatten().next().unwrap_or(0);
        let stored = (0..).zip(self.at).map(|(i, at)| u32::from(at.is_some()) << i).sum();
        let [a, b, c, d, e, f] = self.at.map(|at| at.unwrap_or(any));
        (self != Self::TIGHT).then_some([self.stride, a, b, c, d, e, f, stored])
    }

    /// Bytes from vertex to vertex.
    pub(crate) fn stride(self, format: PoseFormat) -> u32 {
        self.stride * format.number_bytes() as u32
    }

    /// Bytes from the beginning of a vertex to each number.
    pub(crate) fn bytes(self, format: PoseFormat) -> [Option<u32>; POSE_FLOATS] {
        self.at.map(|at| Some(at? * format.number_bytes() as u32))
    }
}
