//! The parts into which an asset in blocks is cut for descriptors: one, or as many as the storage range requires.

use super::descriptors::BufferRange;
use crate::error::{Error, Result};
use crate::pack::PackedLayout;
use crate::pack::formats::{BlockFormat, with_format};
use ash::vk;
use std::ops::Range;

/// A part of an asset: headers and deltas of the entries of some blocks, and their base pose.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct AssetPart {
    /// Blocks of the part; parts follow each other.
    pub(crate) blocks: Range<usize>,
    /// Entries of these blocks; if there are none, one of another block.
    pub(crate) entries: Range<usize>,
    /// Bytes from the beginning of the buffer, a multiple of 256.
    offset: u64,
    size: u64,
    /// Positions, in words, at which headers, deltas and base pose would begin if the part had those of all blocks:
    /// kernels index entries and blocks by their numbers in the mesh. Negative (wrapped) if the first are in other
    /// parts.
    pub(crate) origins: [u32; 3],
    /// The ranges of the mesh's headers, deltas and base pose in this part, in words.
    sources: [Range<usize>; 3],
}

impl AssetPart {
    fn new(layout: &PackedLayout, words: &[u32], blocks: Range<usize>, offset: u64) -> Result<Self> {
        let index = layout.index()?;
        let mut entries = index.entries(blocks.start).start..index.entries(blocks.end - 1).end;
        if entries.is_empty() && index.entry_count() > 0 {
            // Tiles have at least one row, which names some entry.
            let last = entries.start.min(index.entry_count() - 1);
            entries = last..last + 1;
        }
        let (header, delta) = with_format!(index.parts.format, dense _f => (0, [0, 0]), blocks format => {
            let start = |entry: usize| match entry < index.entry_count() {
                true => index.locate(format, words, entry).1.start - index.deltas_at,
                false => words.len() - index.deltas_at,
            };
            (format.header_words(), [start(entries.start), start(entries.end)])
        });
        let base = layout.base_bytes() as usize / 4 / index.count();
        let sources =
            [entries.start * header..entries.end * header, delta[0]..delta[1], blocks.start * base..blocks.end * base];
        let [headers, deltas, bases] = sources.each_ref().map(Range::len);
        let deltas_at = headers.next_multiple_of(4);
        let places = [0, deltas_at, (deltas_at + deltas).next_multiple_of(4)];
        let origins = std::array::from_fn(|i| (places[i] as u32).wrapping_sub(sources[i].start as u32));
        Ok(Self { blocks, entries, offset, size: 4 * (places[2] + bases) as u64, origins, sources })
    }

    /// Cuts an asset with these words into parts of at most `most` bytes; into one if it fits.
    ///
    /// # Errors
    /// [`Error::Invalid`] if one block takes more.
    pub(crate) fn cut(layout: &PackedLayout, words: &[u32], most: u64) -> Result<Vec<Self>> {
        let mut parts: Vec<Self> = vec![];
        for block in 0..layout.index()?.count() {
            if let Some(last) = parts.last_mut() {
                let longer = Self::new(layout, words, last.blocks.start..block + 1, last.offset)?;
                if longer.size <= most {
                    *last = longer;
                    continue;
                }
            }
            let offset = parts.last().map_or(0, Self::end).next_multiple_of(256);
            let part = Self::new(layout, words, block..block + 1, offset)?;
            if part.size > most {
                let text =
                    format!("mesh '{}': a block takes {} bytes; the device allows {most}", layout.name, part.size);
                return Err(Error::invalid(text, "pack into smaller blocks, or in a smaller format"));
            }
            parts.push(part);
        }
        Ok(parts)
    }

    /// Returns the end of the part, in bytes from the beginning of the buffer.
    pub(crate) fn end(&self) -> u64 {
        self.offset + self.size
    }

    /// Returns the range of the base pose in a part that is the whole asset.
    pub(crate) fn base_pose(&self, asset: vk::Buffer, layout: &PackedLayout) -> BufferRange {
        BufferRange::new(asset, self.offset + 4 * u64::from(self.origins[2]), layout.base_bytes())
    }

    pub(crate) fn range(&self, asset: vk::Buffer) -> BufferRange {
        BufferRange::new(asset, self.offset, self.size)
    }

    /// Returns the copies that fill the part from memory that holds the base pose, followed by the words of the mesh.
    pub(crate) fn copies(&self, layout: &PackedLayout) -> [vk::BufferCopy; 3] {
        let base_bytes = layout.base_bytes();
        let place = |i: usize| self.origins[i].wrapping_add(self.sources[i].start as u32);
        let sections = [base_bytes, base_bytes + layout.index_bytes(), 0];
        std::array::from_fn(|i| vk::BufferCopy {
            src_offset: sections[i] + 4 * self.sources[i].start as u64,
            dst_offset: self.offset + 4 * u64::from(place(i)),
            size: 4 * self.sources[i].len() as u64,
        })
    }
}
