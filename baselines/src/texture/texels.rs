//! The images of delta textures: the texel of each vertex, and the deltas of each target, as numbers that shaders load
//! and multiply without decoding.
//!
//! Each vertex that any target moves has its own texel in the displacement textures of an instance; all others share
//! the first one, which no pass draws to. Vertices that the same targets move are neighbours, so that a target is a few
//! rectangles. A delta texture holds the rectangles of all targets one after the other, row by row, without texels in
//! between.

use crate::pack::{DeltaFormat, POSE_FLOATS, PackedGroup};
use deltamorph::{Error, Result};
use std::ops::Range;

/// Runs of texels with at most this many others between them are drawn as one: a texel costs less than a rectangle.
const GAP: u32 = 8;

/// Words of a rectangle.
pub const RECTANGLE_WORDS: usize = 5;

/// A rectangle of texels of the displacement textures that a target moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rectangle {
    /// Column of the first texel.
    pub x: u32,
    /// Row of the first texel.
    pub y: u32,
    /// Texels of a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Texel of the delta textures that holds the first delta, counted row by row; the others follow.
    pub first: u32,
}

/// The delta textures of a group of a mesh, and the positions of its vertices and targets in them.
#[derive(Clone, Debug)]
pub struct DeltaTexels {
    /// Columns, a power of two, and rows of the displacement textures.
    pub size: [u32; 2],
    /// Columns, a power of two, and rows of the delta textures.
    pub image: [u32; 2],
    /// Texel of the displacement textures for each vertex, counted row by row; 0 if no target moves it.
    pub texels: Vec<u32>,
    /// Rectangles of all targets, target after target; those of a target do not overlap.
    pub rectangles: Vec<Rectangle>,
    /// First rectangle of each target, then the number of all.
    pub first: Vec<u32>,
    /// Components are 16-bit integers, steps of the target; else float32.
    pub is_integer: bool,
    /// Deltas of both triples at each texel of the delta textures, in steps of the target.
    deltas: Vec<[f32; POSE_FLOATS]>,
}

impl DeltaTexels {
    /// Bakes both triples of a group, which is of a dense format, for textures of at most `side` texels in either
    /// direction.
    ///
    /// # Errors
    /// The textures would be larger than `side`.
    pub fn bake(group: &PackedGroup, side: u32) -> Result<Self> {
        let (layout, name) = (group.layout(), &group.layout().name);
        let mut movers = vec![vec![]; layout.vertex_count];
        for target in 0..layout.targets.len() {
            group.for_each_delta(target, |vertex, delta| {
                if delta != [0.0; POSE_FLOATS] {
                    movers[vertex].push(target as u32);
                }
            });
        }
        let mut order: Vec<usize> = (0..layout.vertex_count).filter(|&v| !movers[v].is_empty()).collect();
        order.sort_by(|&a, &b| movers[a].cmp(&movers[b]));
        let size = size(order.len() + 1, side, name)?;
        let mut texels = vec![0; layout.vertex_count];
        order.iter().zip(1..).for_each(|(&vertex, texel)| texels[vertex] = texel);

        let (mut rectangles, mut first, mut deltas) = (vec![], vec![0], vec![]);
        for (number, target) in layout.targets.iter().enumerate() {
            let (mut moved, steps) = (vec![], [target.position_step, target.normal_step()].map(f64::from));
            group.for_each_delta(number, |vertex, delta| {
                if delta != [0.0; POSE_FLOATS] {
                    let steps: [f32; POSE_FLOATS] = std::array::from_fn(|c| (delta[c] / steps[c / 3]) as f32);
                    moved.push((texels[vertex], steps));
                }
            });
            moved.sort_by_key(|&(texel, _)| texel);
            let begin = rectangles.len();
            for run in runs(moved.iter().map(|&(texel, _)| texel)) {
                for mut rectangle in rows(run, size[0]) {
                    rectangle.first = deltas.len() as u32;
                    rectangles.push(rectangle);
                    deltas.resize(deltas.len() + (rectangle.width * rectangle.height) as usize, [0.0; POSE_FLOATS]);
                }
            }
            // Both ascend.
            let mut own = rectangles[begin..].iter().peekable();
            for (texel, delta) in moved {
                while let Some(at) = own.peek().map(|r: &&Rectangle| r.index(texel, size[0])) {
                    if let Some(at) = at {
                        deltas[at as usize] = delta;
                        break;
                    }
                    own.next();
                }
            }
            first.push(rectangles.len() as u32);
        }
        let image = self::size(deltas.len(), side, name)?;
        Ok(Self { size, image, texels, rectangles, first, is_integer: layout.format == DeltaFormat::Snorm16, deltas })
    }

    /// Returns the number of texels that the rectangles of all targets cover.
    pub fn covered(&self) -> usize {
        self.deltas.len()
    }

    /// Iterates over the numbers of a delta texture, row by row: of positions, or of normals. The fourth component and
    /// the texels after the last delta are 0.
    pub fn numbers(&self, normals: bool) -> impl Iterator<Item = f32> {
        let texels = self.image[0] as usize * self.image[1] as usize;
        let first = if normals { 3 } else { 0 };
        let of = move |d: &[f32; POSE_FLOATS]| [d[first], d[first + 1], d[first + 2], 0.0];
        (0..texels).flat_map(move |texel| self.deltas.get(texel).map_or([0.0; 4], of))
    }

    /// Returns the bytes of a delta texture.
    pub fn bytes(&self, normals: bool) -> Vec<u8> {
        let numbers = self.numbers(normals);
        if self.is_integer {
            numbers.flat_map(|steps| (steps as i16).to_le_bytes()).collect()
        } else {
            numbers.flat_map(f32::to_le_bytes).collect()
        }
    }

    /// Returns the rectangles, followed by the texels of `vertices` vertices, padding included, as shaders read them.
    pub fn words(&self, vertices: usize) -> Vec<u32> {
        let mut words: Vec<u32> = self.rectangles.iter().flat_map(|r| [r.x, r.y, r.width, r.height, r.first]).collect();
        let texels_at = words.len();
        words.extend(&self.texels);
        words.resize(texels_at + vertices, 0);
        words
    }
}

impl Rectangle {
    /// Returns the texel of the delta textures for a texel of the displacement textures, if it is within.
    fn index(&self, texel: u32, width: u32) -> Option<u32> {
        let (x, y) = ((texel % width).checked_sub(self.x)?, (texel / width).checked_sub(self.y)?);
        (x < self.width && y < self.height).then(|| self.first + y * self.width + x)
    }
}

/// Returns columns, a power of two, and rows for this many texels, about square.
fn size(texels: usize, side: u32, name: &str) -> Result<[u32; 2]> {
    let width = ((texels as f64).sqrt().ceil() as u32).next_power_of_two().clamp(1, side.max(1));
    match u32::try_from(texels.div_ceil(width as usize).max(1)) {
        Ok(height) if height <= side => Ok([width, height]),
        _ => Err(Error::invalid(
            format!("mesh '{name}': {texels} texels in an image of at most {side} × {side}"),
            "use fewer targets, or split the mesh",
        )),
    }
}

/// Returns runs of ascending texels, with inner gaps of at most [`GAP`].
fn runs(texels: impl Iterator<Item = u32>) -> Vec<Range<u32>> {
    let mut runs: Vec<Range<u32>> = vec![];
    for texel in texels {
        match runs.last_mut() {
            Some(run) if texel - run.end <= GAP => run.end = texel + 1,
            _ => runs.push(texel..texel + 1),
        }
    }
    runs
}

/// Splits a run into rectangles: the rest of its first row, whole rows, the beginning of its last row.
fn rows(run: Range<u32>, width: u32) -> impl Iterator<Item = Rectangle> {
    let head = run.start..run.end.min(run.start.next_multiple_of(width));
    let whole = head.end..(run.end - run.end % width).max(head.end);
    let tail = whole.end..run.end;
    [head, whole, tail].into_iter().filter(|part| !part.is_empty()).map(move |part| {
        let (texels, x) = (part.end - part.start, part.start % width);
        let columns = texels.min(width - x);
        Rectangle { x, y: part.start / width, width: columns, height: texels / columns, first: 0 }
    })
}
