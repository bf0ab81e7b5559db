//! The streams of a mesh: what a vertex has besides a position, and how streams share a *group*.
//!
//! A group is a vertex of six numbers, in two *triples*. Every kernel, pose buffer and packed delta works on groups,
//! whatever their numbers mean. Streams are laid out in the order of [`Semantic`], each in the first group that has room
//! for all of its components:
//!
//! ```text
//! group 0    position x y z | normal x y z
//! group 1    tangent  x y z | tangent w, texcoord 0 u v
//! ```
//!
//! Components that no stream fills are zero, and no target moves them.

use std::collections::BTreeSet;
use std::fmt;

/// Numbers of a vertex in a group.
pub const GROUP_COMPONENTS: usize = 6;

/// Numbers of a triple: the components of a group that share a quantisation step.
pub const TRIPLE: usize = 3;

/// Triples of a group.
pub const TRIPLES: usize = GROUP_COMPONENTS / TRIPLE;

/// What the numbers of a stream mean. The order is the one in which streams are laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum Semantic {
    /// Where the vertex is.
    Position,
    /// Which way the surface faces. Poses hold the sum; whoever reads them normalises.
    Normal,
    /// Direction of the texture's u axis, and the handedness of the bitangent in w, which does not morph.
    Tangent,
    /// A set of texture coordinates.
    TexCoord(u8),
    /// A set of colours with opacity.
    Color(u8),
    /// Wrinkle masks: by which share the skin is compressed upwards and across, less than 0 where it is stretched. 0 in the
    /// base pose; a shader blends normal maps of wrinkles in where they are large.
    Mask,
}

/// How the error of a stream is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Measure {
    /// Distance in input units. Error budgets and drift bounds are lengths as well.
    Length,
    /// Angle between directions, in degrees.
    Angle,
    /// Difference of each component.
    Absolute,
}

impl Semantic {
    /// Components, how many of them morph (the first ones), and how errors are measured.
    const fn properties(self) -> (usize, usize, Measure) {
        match self {
            Self::Position => (3, 3, Measure::Length),
            Self::Normal => (3, 3, Measure::Angle),
            Self::Tangent => (4, 3, Measure::Angle),
            Self::TexCoord(_) => (2, 2, Measure::Absolute),
            Self::Color(_) => (4, 4, Measure::Absolute),
            Self::Mask => (2, 2, Measure::Absolute),
        }
    }

    /// A number of its own. The derived comparison may look at the set of what has none, which tools that look for memory
    /// that nobody wrote report.
    #[doc(hidden)]
    pub const fn number(self) -> u16 {
        match self {
            Self::Position => 0,
            Self::Normal => 1,
            Self::Tangent => 2,
            Self::TexCoord(set) => 0x100 | set as u16,
            Self::Color(set) => 0x200 | set as u16,
            Self::Mask => 0x300,
        }
    }

    /// Numbers of a vertex.
    pub const fn components(self) -> usize {
        self.properties().0
    }

    /// Numbers of a delta: the first of the components.
    pub const fn morphing_components(self) -> usize {
        self.properties().1
    }

    /// How errors are measured.
    pub const fn measure(self) -> Measure {
        self.properties().2
    }
}

/// The name in reports and messages.
impl fmt::Display for Semantic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Position => f.write_str("position"),
            Self::Normal => f.write_str("normal"),
            Self::Tangent => f.write_str("tangent"),
            Self::TexCoord(set) => write!(f, "texcoord {set}"),
            Self::Color(set) => write!(f, "color {set}"),
            Self::Mask => f.write_str("wrinkle mask"),
        }
    }
}

/// A stream of a mesh beside positions and normals.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamData {
    /// What it is.
    pub semantic: Semantic,
    /// [`components`](Semantic::components) numbers for each vertex.
    pub values: Vec<f32>,
}

/// What a target changes of a stream.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StreamDeltas {
    /// Vertices with a delta, ascending, without repeats.
    pub vertices: Vec<u32>,
    /// [`morphing_components`](Semantic::morphing_components) numbers for each of `vertices`.
    pub deltas: Vec<f32>,
}

/// A stream's place in a group.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StreamPlace {
    /// The stream.
    pub semantic: Semantic,
    /// Its first component in the group.
    pub first: usize,
}

impl StreamPlace {
    /// The components of the group that hold the stream.
    pub const fn components(&self) -> std::ops::Range<usize> {
        self.first..self.first + self.semantic.components()
    }

    /// The components of the group that targets move.
    pub const fn morphing_components(&self) -> std::ops::Range<usize> {
        self.first..self.first + self.semantic.morphing_components()
    }
}

/// Lay out position, normal and the streams `further` in groups; each group lists its streams by component.
///
/// The first group is always position and normal. A semantic that comes twice takes one place.
pub fn group_streams(further: impl IntoIterator<Item = Semantic>) -> Vec<Vec<StreamPlace>> {
    let semantics = BTreeSet::from_iter([Semantic::Position, Semantic::Normal].into_iter().chain(further));
    let mut groups: Vec<Vec<StreamPlace>> = vec![];
    let used = |group: &[StreamPlace]| group.last().map_or(0, |place| place.components().end);
    for semantic in semantics {
        let fits = groups.iter().position(|group| used(group) + semantic.components() <= GROUP_COMPONENTS);
        let at = fits.unwrap_or(groups.len());
        groups.resize(groups.len().max(at + 1), vec![]);
        let first = used(&groups[at]);
        groups[at].push(StreamPlace { semantic, first });
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::Semantic::*;
    use super::*;

    #[test]
    fn streams_take_the_first_group_with_room() {
        let groups = [
            vec![(Position, 0), (Normal, 3)],
            vec![(Tangent, 0), (TexCoord(0), 4)],
            vec![(TexCoord(1), 0), (Color(0), 2)],
            vec![(Color(1), 0), (Mask, 4)],
        ];
        let all = [Mask, Color(0), TexCoord(1), TexCoord(0), Tangent, Color(1), TexCoord(1)];
        for (further, count) in [(&[][..], 1), (&[Normal, Position], 1), (&[TexCoord(0), Tangent], 2), (&all, 4)] {
            let places = |group: &Vec<StreamPlace>| group.iter().map(|p| (p.semantic, p.first)).collect();
            let found: Vec<Vec<_>> = group_streams(further.iter().copied()).iter().map(places).collect();
            assert_eq!(found, groups[..count]);
        }
    }

    #[test]
    fn what_is_measured_as_length_or_angle_has_a_triple_of_its_own() {
        let all = [Tangent, TexCoord(0), TexCoord(1), TexCoord(2), Color(0), Color(1), Mask];
        for mask in 0..1 << all.len() {
            let chosen = all.iter().enumerate().filter(|(i, _)| mask >> i & 1 != 0).map(|(_, s)| *s);
            for place in group_streams(chosen).into_iter().flatten() {
                if place.semantic.measure() != Measure::Absolute {
                    assert_eq!((place.first % TRIPLE, place.semantic.morphing_components()), (0, TRIPLE));
                }
                assert!(place.components().end <= GROUP_COMPONENTS);
            }
        }
    }
}
