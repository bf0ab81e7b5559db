//! The output of a post-morph pass for each vertex, in a buffer of the host's.

use crate::prelude::*;

/// Initial words of a buffer: no number of a pose.
const POISON: u32 = 0xffff_ffff;

/// A buffer, and the layout of vertices in it: offset, stride, and bytes from a position to its normal.
pub struct Written<'a> {
    host: &'a Buffers<'a>,
    pub buffer: vk::Buffer,
    pub place: (u64, u32, Option<u32>),
    words: Shared,
    pub vertices: usize,
}

impl<'a> Written<'a> {
    pub fn new(host: &'a Buffers<'a>, vertices: usize, place: (u64, u32, Option<u32>)) -> Self {
        let (offset, stride, normals) = place;
        let bytes = offset as usize + (vertices - 1) * stride as usize + 12 + normals.unwrap_or(0) as usize;
        let words = host.shared(bytes);
        host.fill(&words, POISON);
        Self { host, buffer: words.buffer, place, words, vertices }
    }

    /// Takes the written vertices as positions and normals: `None` if not written since the last time. Asserts that
    /// bytes in between are unchanged.
    pub fn take(&self) -> Vec<Option<Vec<u32>>> {
        let mut words = self.host.contents::<u32>(&self.words);
        self.host.fill(&self.words, POISON);
        let mut take =
            |at: u64| (at as usize / 4..).take(3).map(|i| std::mem::replace(&mut words[i], POISON)).collect();
        let (offset, stride, normals) = self.place;
        let taken = (0..self.vertices as u64).map(|v| {
            let at = offset + v * u64::from(stride);
            let triples: Vec<Vec<u32>> =
                [Some(0), normals].into_iter().flatten().map(|n| take(at + u64::from(n))).collect();
            let vertex = triples.concat();
            let unwritten = vertex.iter().filter(|word| **word == POISON).count();
            assert!(unwritten == 0 || unwritten == vertex.len(), "a vertex is written, or not");
            (unwritten == 0).then_some(vertex)
        });
        let taken = taken.collect();
        assert!(words.iter().all(|word| *word == POISON), "what lies between vertices is the host's");
        taken
    }
}
