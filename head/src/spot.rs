//! What a vertex of the net is: its part, its place in the net, the opening that it lies behind.

/// The part that a vertex belongs to.
#[derive(Clone, Copy, PartialEq)]
pub enum Part {
    Skin,
    Eye,
    UpperTeeth,
    LowerTeeth,
    Tongue,
}

/// An opening of the skin, along which a row has a lower and an upper side.
#[derive(Clone, Copy, PartialEq)]
pub enum Slit {
    Eye,
    Ear,
    Mouth,
}

impl Slit {
    /// Returns the section along which it lies.
    pub const fn row(self) -> f32 {
        match self {
            Self::Eye => 7.0,
            Self::Ear => 8.0,
            Self::Mouth => 11.0,
        }
    }

    /// Returns the number of rings behind an opening with `around` vertices at its edge.
    pub fn rings(self, around: usize) -> usize {
        match self {
            Self::Eye => (around / 3).clamp(2, 10),
            Self::Ear => (around / 2).max(2),
            Self::Mouth => (around / 6).max(3),
        }
    }
}

/// Position of a vertex in the net.
#[derive(Clone, Copy)]
pub struct Spot {
    pub part: Part,
    /// It is on the head's right side; all other fields describe its mirror image.
    pub mirrored: bool,
    /// Skin: the angle from the front. Other parts: the position around the axis.
    pub a: f32,
    /// Skin: the position among the sections. Other parts: the position along the axis.
    pub t: f32,
    /// The height of its section, before eyes and ears displace rows.
    pub height: f32,
    /// It is on or behind the lower edge of an opening.
    pub lower: bool,
    /// The opening that it lies behind, and the depth, in (0, 1].
    pub behind: Option<(Slit, f32)>,
}
