//! Tracks which parts of a head updates have changed, and how long ago.

use deltamorph::PackedLayout;
use std::ops::Range;

/// Vertices that share a brightness: as many as in the smallest block. `PIECE` in glsl/scene.glsl.
const PIECE: u32 = 32;

/// Brightness of each piece of 32 vertices of a head, in the order of pose buffers: 1 after an update that changed the
/// piece, then fading.
#[derive(Clone, Debug, PartialEq)]
pub struct Glow {
    pieces: Vec<f32>,
}

impl Glow {
    /// Makes the glow of a head of the mesh with this `layout`, all dark.
    pub fn new(layout: &PackedLayout) -> Self {
        Self { pieces: vec![0.0; layout.padded_vertices().div_ceil(PIECE as usize)] }
    }

    /// Brightens the vertices that an update changed ([`Crowd::changed`](deltamorph::Crowd::changed)). Pieces changed
    /// before keep the share `kept` of their brightness, 0 to 1.
    pub fn update(&mut self, changed: &[Range<u32>], kept: f32) {
        self.pieces.iter_mut().for_each(|piece| *piece *= kept);
        for vertices in changed {
            let most = self.pieces.len();
            let first = (vertices.start / PIECE) as usize;
            let end = (vertices.end.div_ceil(PIECE) as usize).min(most);
            self.pieces[first.min(end)..end].fill(1.0);
        }
    }

    /// Returns the brightness of each piece, 0 to 1.
    pub fn pieces(&self) -> &[f32] {
        &self.pieces
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_changed_glows_and_goes_out() {
        let mut glow = Glow { pieces: vec![0.0; 6] };
        glow.update(&[0..64, 128..160], 0.5);
        assert_eq!(glow.pieces(), [1.0, 1.0, 0.0, 0.0, 1.0, 0.0]);
        glow.update(&[32..64, 0..0], 0.5);
        assert_eq!(glow.pieces(), [0.5, 1.0, 0.0, 0.0, 0.5, 0.0]);
        // There are no pieces after the last vertex.
        glow.update(&[96..u32::MAX, 0..0], 0.0);
        assert_eq!(glow.pieces(), [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
        glow.update(&[640..704, 0..0], 1.0);
        assert_eq!(glow.pieces(), [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
    }
}
