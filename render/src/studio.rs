//! Pictures without a window.

use crate::heads::{Heads, HeadsDesc};
use crate::parts::Part;
use crate::scene::{Scene, Show};
use crate::target::{Picture, Target};
use deltamorph::{Error, KeptMesh, PackedMesh, Result};
use deltamorph_headless::Headless;
use glam::Mat4;
use std::sync::Arc;

/// Draws pictures of a mesh, one after the other.
pub struct Studio<'a> {
    headless: &'a Headless,
    // Dropped before the heads.
    target: Target,
    heads: Heads,
    draws: [usize; 2],
}

impl<'a> Studio<'a> {
    /// Makes a studio for pictures of this width and height (≥ 1) of heads of `mesh`, which was packed as `packed` and
    /// consists of `parts`.
    ///
    /// # Errors
    /// Those of [`Heads::new`]; pictures are larger than the device draws.
    pub fn new(
        headless: &'a Headless,
        mesh: &KeptMesh,
        packed: &Arc<PackedMesh>,
        parts: &[Part],
        size: [u32; 2],
        desc: &HeadsDesc<'_>,
    ) -> Result<Self> {
        // SAFETY: the device is that of `headless`, which outlives the studio; `draw` waits; the target is dropped
        // first.
        let heads = unsafe { Heads::new(headless, mesh, packed, parts, desc) }?;
        // SAFETY: as above.
        let target = unsafe { heads.target(size) }?;
        Ok(Self { headless, target, heads, draws: [0; 2] })
    }

    /// Draws all heads, with these weights and at `places`, in front of `background` (linear red, green, blue, and
    /// opacity; colours are multiplied by it).
    ///
    /// # Errors
    /// The numbers of weights, places and heads differ; weights are not valid; or the device fails. The picture is not
    /// drawn then; after a device has failed, no other is.
    pub fn draw(
        &mut self,
        weights: &[impl AsRef<[f32]>],
        places: &[Mat4],
        scene: &Scene,
        background: [f32; 4],
    ) -> Result<Picture> {
        let Self { headless, target, heads, draws } = self;
        let mut updated = None;
        let drawn = headless.run(|cmd| {
            // SAFETY: `run` hands out a recording buffer, submits it once, and waits; else the update is discarded.
            updated = Some(unsafe { heads.update(headless.engine(), cmd, weights) }?);
            if scene.show == Show::Motion && !heads.has_previous()? {
                return Err(Error::invalid(
                    "the previous pose, which the update has overwritten, or which has recomputed normals",
                    "use two slots or more, three on the path feedback, and the normals of targets",
                ));
            }
            // SAFETY: as above, after the update; the target is that of the heads, and is copied after the draws.
            unsafe {
                *draws = heads.record(cmd, target, places, scene, background)?;
                target.copy_pixels(cmd);
            }
            Ok(())
        });
        if let (Err(_), Some(updated)) = (&drawn, &updated) {
            heads.discard(updated)?;
        }
        drawn.and_then(|()| target.picture())
    }

    /// Returns the numbers of draws of the last picture: recorded, and skipped by culling ([`HeadsDesc::cull`]).
    pub fn draws(&self) -> [usize; 2] {
        self.draws
    }
}
