//! The streams of a mesh: the vertex attributes, position included, and how they share *groups*.
//!
//! A group holds six numbers per vertex, in two *triples*. Every kernel, pose buffer and packed delta works on groups,
//! whatever the numbers mean. Streams are laid out in the order of [`Semantic`], each in the first group that has room
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

/// Numbers per vertex in a group.
pub const GROUP_COMPONENTS: usize = 6;

/// Numbers in a triple: the components of a group that share a quantisation step.
pub const TRIPLE: usize = 3;

/// Triples in a group.
pub const TRIPLES: usize = GROUP_COMPONENTS / TRIPLE;

/// The list of streams: documentation and name, with the type of the set where there are several; the number in packed
/// files and in C; the name in messages; components, how many of them morph (the first ones), and how errors are
/// measured.
macro_rules! semantics {
    ($($(#[doc = $doc:literal])* $name:ident $(($set:ident: $type:ty))? {
        $id:literal, $text:literal, $components:literal, $morphing:literal, $measure:ident
    })*) => {
        /// The meaning of a stream's numbers. Streams are laid out in this order.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[non_exhaustive]
        pub enum Semantic {
            $($(#[doc = $doc])* $name $(($type))?,)*
        }

        impl Semantic {
            /// Unique id, also in packed files: the kind of stream, and the set × 256.
            // Used instead of the derived `PartialEq`, which may read the uninitialised payload of unit variants;
            // memory checkers report that.
            #[doc(hidden)]
            pub const fn id(self) -> u32 {
                match self {
                    $(Self::$name $(($set))? => $id $(| ($set as u32) << 8)?,)*
                }
            }

            /// The stream with this number in packed files: the kind of stream, and the set × 256.
            #[doc(hidden)]
            pub fn from_id(id: u32) -> Option<Self> {
                let semantic = match id & 0xff {
                    $($id => Self::$name $(((id >> 8) as $type))?,)*
                    _ => return None,
                };
                Some(semantic).filter(|semantic| semantic.id() == id)
            }

            const fn properties(self) -> (usize, usize, Measure) {
                match self {
                    $(Self::$name { .. } => ($components, $morphing, Measure::$measure),)*
                }
            }
        }

        /// The name in reports and messages.
        impl fmt::Display for Semantic {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                match self {
                    $(Self::$name $(($set))? => {
                        f.write_str($text)?;
                        $(write!(f, " {}", $set)?;)?
                    })*
                }
                Ok(())
            }
        }
    };
}

semantics! {
    /// Position of the vertex.
    Position { 1, "position", 3, 3, Length }
    /// Normal of the surface. Poses hold the unnormalised sum; consumers normalise it.
    Normal { 2, "normal", 3, 3, Angle }
    /// Direction of the texture's u axis, and the handedness of the bitangent in w, which does not morph.
    Tangent { 3, "tangent", 4, 3, Angle }
    /// A set of texture coordinates.
    TexCoord(set: u8) { 4, "texcoord", 2, 2, Absolute }
    /// A set of colours with opacity.
    Color(set: u8) { 5, "color", 4, 4, Absolute }
    /// Wrinkle masks: the share by which the skin is compressed upwards and across; negative where it is stretched, 0
    /// in the base pose. A shader blends in normal maps of wrinkles where they are large.
    Mask { 6, "wrinkle mask", 2, 2, Absolute }
}

/// How the error of a stream is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[doc(hidden)]
#[non_exhaustive]
pub enum Measure {
    /// Distance in input units. Error budgets and drift bounds are lengths, too.
    Length,
    /// Angle between directions, in degrees.
    Angle,
    /// Difference of each component.
    Absolute,
}

impl Semantic {
    /// Numbers per vertex.
    pub const fn components(self) -> usize {
        self.properties().0
    }

    /// Numbers per delta: the first of the components.
    #[doc(hidden)]
    pub const fn morphing_components(self) -> usize {
        self.properties().1
    }

    /// Returns how errors are measured.
    #[doc(hidden)]
    pub const fn measure(self) -> Measure {
        self.properties().2
    }
}

/// A stream of a mesh other than positions and normals.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamData {
    /// The meaning of the numbers.
    pub semantic: Semantic,
    /// [`components`](Semantic::components) numbers for each vertex.
    pub values: Vec<f32>,
}

/// The changes that a target makes to a stream.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StreamDeltas {
    /// Vertices with a delta, ascending, without repeats.
    pub vertices: Vec<u32>,
    /// [`morphing_components`](Semantic::morphing_components) numbers for each of `vertices`.
    pub deltas: Vec<f32>,
}

/// The components of a group that hold a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StreamPlace {
    /// The stream.
    pub semantic: Semantic,
    /// First component in the group.
    pub first: usize,
}

impl StreamPlace {
    /// Returns the components of the group that hold the stream.
    pub const fn components(&self) -> std::ops::Range<usize> {
        self.first..self.first + self.semantic.components()
    }

    /// Returns the components of the group that targets change.
    #[doc(hidden)]
    pub const fn morphing_components(&self) -> std::ops::Range<usize> {
        self.first..self.first + self.semantic.morphing_components()
    }
}

/// Lays out position, normal and the streams `further` in groups; each group lists its streams by component.
///
/// The first group is always position and normal. Repeated semantics are laid out once.
pub fn group_streams(further: impl IntoIterator<Item = Semantic>) -> Vec<Vec<StreamPlace>> {
    let semantics = BTreeSet::from_iter([Semantic::Position, Semantic::Normal].into_iter().chain(further));
    let mut groups: Vec<Vec<StreamPlace>> = vec![];
    let used = |group: &[StreamPlace]| group.last().map_or(0, |place| place.components().end);
    for semantic in semantics {
        let has_room = |group: &&mut Vec<_>| used(group) + semantic.components() <= GROUP_COMPONENTS;
        match groups.iter_mut().find(has_room) {
            Some(group) => group.push(StreamPlace { semantic, first: used(group) }),
            None => groups.push(vec![StreamPlace { semantic, first: 0 }]),
        }
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
