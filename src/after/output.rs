//! Targets of the passes that write poses: streams in buffers of the application.

use super::context::TargetContext;
use super::skin::Joints;
use crate::abi::numbers::{SNORM8, SNORM10, SNORM16, UNIT_FLOATS};
use crate::asset::streams::{Measure, Semantic};
use crate::error::{Result, ensure, refuse};
use crate::gpu::descriptors::BufferRange;
use crate::update::technique::place_of;
use ash::vk;

/// Largest alignment of storage-buffer offsets of any device.
const ALIGNMENT: u64 = 256;

/// Most streams that a pass writes.
const STREAMS: usize = 2;

/// A stream of poses in vertices of the application: buffer, offset, stride and format of their own.
///
/// Positions, and normals of 8 bits each, in vertices of 48 bytes:
/// ```
/// # use deltamorph::{Semantic, after::OutputStream, ash::vk};
/// # let buffer = vk::Buffer::null();
/// let positions = OutputStream { stride: 48, ..OutputStream::new(Semantic::Position, buffer) };
/// let format = vk::Format::R8G8B8A8_SNORM;
/// let normals = OutputStream { offset: 12, stride: 48, format, ..OutputStream::new(Semantic::Normal, buffer) };
/// ```
#[derive(Clone, Copy, Debug)]
pub struct OutputStream {
    /// A stream of the mesh.
    pub semantic: Semantic,
    /// The buffer, with storage buffer usage.
    pub buffer: vk::Buffer,
    /// Byte offset of the first vertex's stream, a multiple of 4.
    pub offset: u64,
    /// Bytes from vertex to vertex, a multiple of 4.
    pub stride: u32,
    /// `R32G32_SFLOAT`, `R32G32B32_SFLOAT` or `R32G32B32A32_SFLOAT`; for normals and tangents also
    /// `R16G16B16A16_SNORM`, `R8G8B8A8_SNORM` or `A2B10G10R10_SNORM_PACK32`. Normals and tangents have unit length.
    /// Components that do not morph keep their values: a fourth one beside positions and normals, and the handedness of
    /// a tangent in w.
    pub format: vk::Format,
    /// Second buffer and offset, with the same stride; all streams of a target have one, or none. Updates write the two
    /// in turn, and the other one holds the [previous](OutputView::previous) output, for motion vectors, without a
    /// copy.
    pub second: Option<(vk::Buffer, u64)>,
}

impl OutputStream {
    /// Contiguous float32 numbers from the start of the buffer, without components that do not morph.
    pub fn new(semantic: Semantic, buffer: vk::Buffer) -> Self {
        let components = semantic.morphing_components() as u32;
        let format = match components {
            2 => vk::Format::R32G32_SFLOAT,
            3 => vk::Format::R32G32B32_SFLOAT,
            _ => vk::Format::R32G32B32A32_SFLOAT,
        };
        Self { semantic, buffer, offset: 0, stride: 4 * components, format, second: None }
    }

    /// The number of the format in `glsl/after.glsl`, and the bytes of a vertex that are written.
    fn encoding(&self) -> Option<(u32, u32)> {
        let morphing = self.semantic.morphing_components() as u32;
        let is_direction = self.semantic.measure() == Measure::Angle;
        let floats = |components| {
            let format = if is_direction { UNIT_FLOATS } else { morphing };
            (morphing <= components).then_some((format, 4 * morphing))
        };
        match self.format {
            vk::Format::R32G32_SFLOAT => floats(2),
            vk::Format::R32G32B32_SFLOAT => floats(3),
            vk::Format::R32G32B32A32_SFLOAT => floats(4),
            vk::Format::R16G16B16A16_SNORM if is_direction => Some((SNORM16, 8)),
            vk::Format::R8G8B8A8_SNORM if is_direction => Some((SNORM8, 4)),
            vk::Format::A2B10G10R10_SNORM_PACK32 if is_direction => Some((SNORM10, 4)),
            _ => None,
        }
    }

    /// The place in output buffer 0, or 1 if there is a second one.
    fn place(&self, output: usize) -> (vk::Buffer, u64) {
        self.second.filter(|_| output == 1).unwrap_or((self.buffer, self.offset))
    }
}

/// Output of an instance's pose into vertices of the application, skinned or not; see
/// [`MorphEngine::set_output_target`](crate::MorphEngine::set_output_target).
#[derive(Clone, Copy)]
pub struct OutputTarget<'a> {
    /// The streams that are written, which do not overlap. Streams of a group (such as position and normal) in the same
    /// buffer are written by one dispatch.
    pub streams: &'a [OutputStream],
    /// `false`: vertices have the order of the mesh as it was imported or handed in, so that indices and further
    /// attributes of the application stay as they are. `true`: the order of pose buffers, with
    /// [`PackedLayout::indices`](crate::PackedLayout::indices). There are
    /// [`PackedLayout::vertex_count`](crate::PackedLayout::vertex_count) of them in either case, without padding.
    pub pose_order: bool,
    /// The joints that skin positions and normals; `None`: they are not skinned. Tangents cannot be skinned.
    pub joints: Option<Joints<'a>>,
}

impl<'a> OutputTarget<'a> {
    /// These streams in the order of the mesh, not skinned.
    pub fn new(streams: &'a [OutputStream]) -> Self {
        Self { streams, pose_order: false, joints: None }
    }
}

/// Locations of an instance's output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct OutputView {
    /// Buffer, and byte offset of the first vertex, of the target's first stream.
    pub current: (vk::Buffer, u64),
    /// The same before the last update; equal to `current` if nothing changed, on the first update and after a reset;
    /// `None` if the update overwrote it.
    pub previous: Option<(vk::Buffer, u64)>,
}

/// A stream that a pass writes.
struct Written {
    stream: OutputStream,
    /// The first of the group's numbers that it has.
    first: u32,
    format: u32,
    /// Bytes of a vertex that are written.
    bytes: u32,
}

/// Streams of one group in one buffer, which a pass writes.
pub(super) struct Part {
    /// The group.
    pub group: usize,
    /// Up to [`STREAMS`].
    written: Vec<Written>,
    vertices: u64,
}

impl Part {
    /// The parts of a target; `what` names it in errors.
    ///
    /// # Errors
    /// No streams; a stream that the mesh does not have, with an invalid format, offset or stride, or too large for the
    /// device; second buffers of some streams.
    pub fn of(what: &str, streams: &[OutputStream], context: &TargetContext<'_>) -> Result<Vec<Self>> {
        ensure!(!streams.is_empty(), format!("{what} without streams"), "name the streams that it writes");
        let device = context.device;
        let layout = context.layout();
        let limit = device.caps.max_storage_range;
        let mut parts: Vec<Self> = vec![];
        for stream in streams {
            let &OutputStream { semantic, offset, stride, format, second, .. } = stream;
            let (group, place) = place_of(context.groups, semantic)?;
            let what = format!("stream '{semantic}' of {what}");
            let Some((encoding, bytes)) = stream.encoding() else {
                let remedy = "use a float32 format with its components, or for normals and tangents \
                              R16G16B16A16_SNORM, R8G8B8A8_SNORM or A2B10G10R10_SNORM_PACK32";
                return refuse(format!("{what} in the format {format:?}"), remedy);
            };
            let offsets = [offset, second.map_or(0, |(_, offset)| offset)];
            let fits = offsets.iter().all(|offset| offset.is_multiple_of(4));
            let fits = fits && stride.is_multiple_of(4) && stride >= bytes;
            let text = format!("{what} at offsets {offsets:?} with stride {stride}");
            ensure!(fits, text, format!("use multiples of 4, and a stride of at least {bytes}"));
            let same = second.is_some() == streams[0].second.is_some();
            let text = format!("{what}: some streams have a second buffer, others none");
            ensure!(same, text, "give one to all streams, or to none");
            let written = Written { stream: *stream, first: place.first as u32, format: encoding, bytes };
            let mut part = Self { group, written: vec![written], vertices: layout.vertex_count as u64 };
            for output in 0..part.outputs() {
                let size = (part.range(output).size, "bytes", limit);
                let what = format!("{what} for mesh '{}' takes", layout.name);
                device.caps.check_limit(&what, size, "use a smaller stride")?;
            }
            match parts.iter_mut().find(|earlier| earlier.takes(&part, limit)) {
                Some(earlier) => earlier.written.append(&mut part.written),
                None => parts.push(part),
            }
        }
        Ok(parts)
    }

    /// Whether another part can be written with this one.
    fn takes(&self, other: &Self, limit: u64) -> bool {
        let together = |output| {
            let [(begin, end), (other_begin, other_end)] = [self, other].map(|part| part.bytes(output));
            let bytes = end.max(other_end) - begin.min(other_begin);
            self.place(output).0 == other.place(output).0 && bytes <= limit
        };
        self.group == other.group && self.written.len() < STREAMS && (0..self.outputs()).all(together)
    }

    /// Number of output buffers: 1 or 2.
    pub fn outputs(&self) -> usize {
        1 + usize::from(self.written[0].stream.second.is_some())
    }

    /// The place of the first stream in an output buffer.
    pub fn place(&self, output: usize) -> (vk::Buffer, u64) {
        self.written[0].stream.place(output)
    }

    fn offsets(&self, output: usize) -> impl Iterator<Item = u64> {
        self.written.iter().map(move |written| written.stream.place(output).1)
    }

    /// First and last byte of an output buffer that are written; the first is aligned.
    fn bytes(&self, output: usize) -> (u64, u64) {
        let begin = self.offsets(output).min().unwrap_or(0);
        let ends = self.offsets(output).zip(&self.written).map(|(offset, written)| {
            let last = (self.vertices - 1) * u64::from(written.stream.stride);
            offset.saturating_add(last + u64::from(written.bytes))
        });
        (begin - begin % ALIGNMENT, ends.max().unwrap_or(0))
    }

    /// The descriptor range in an output buffer, which is aligned.
    pub fn range(&self, output: usize) -> BufferRange {
        let (begin, end) = self.bytes(output);
        BufferRange::new(self.place(output).0, begin, end - begin)
    }

    /// The words of the range at which the streams start.
    pub fn first_words(&self, output: usize) -> [u32; STREAMS] {
        let begin = self.bytes(output).0;
        let mut words = self.offsets(output).map(|offset| ((offset - begin) / 4) as u32);
        std::array::from_fn(|_| words.next().unwrap_or(0))
    }

    /// Words from vertex to vertex, by stream.
    pub fn strides(&self) -> [u32; STREAMS] {
        std::array::from_fn(|i| self.written.get(i).map_or(0, |written| written.stream.stride / 4))
    }

    /// Specialization constants of `glsl/after.glsl`: the first number and the format of each stream.
    pub fn constants(&self) -> [u32; 2 * STREAMS] {
        let of = |i: usize| self.written.get(i).map_or([0, 0], |written| [written.first, written.format]);
        let [[a, b], [c, d]] = [of(0), of(1)];
        [a, b, c, d]
    }

    /// Whether it has this stream.
    pub fn has(&self, semantic: Semantic) -> bool {
        self.written.iter().any(|written| written.stream.semantic == semantic)
    }
}
