//! The source of the poses of a picture.

use crate::wrinkles::MaskPlace;
use deltamorph::{CpuCrowd, PackedMesh, Result, UpdateDesc};
use std::ops::Range;

/// The source of the poses of a picture.
#[derive(Clone, Copy, Debug)]
pub enum Poses<'a> {
    /// The crowd computes them, from these weights of each head.
    Weights(&'a [&'a [f32]]),
    /// The host provides the pose of each head.
    Stored(&'a [StoredPose<'a>]),
}

/// A pose that the host provides.
#[derive(Clone, Copy, Debug)]
pub struct StoredPose<'a> {
    /// The bytes of the pose in its format.
    pub pose: &'a [u8],
    /// The units of fixed-point poses: [`PoseView::units`](deltamorph::PoseView::units); 1 for float32 poses.
    pub units: [f32; 2],
    /// The vertices that changed.
    pub changed: &'a [Range<u32>],
    /// For [`Show::Wrinkles`](crate::Show::Wrinkles), the pose of the group that has the masks
    /// ([`MaskPlace::group`](crate::wrinkles::MaskPlace)), and its units.
    pub masks: Option<(&'a [u8], [f32; 2])>,
}

impl<'a> StoredPose<'a> {
    /// Takes the pose of a head from a crowd on the path `cpu`, which updates `mesh` with `desc`. `changed` is
    /// [`CpuCrowd::changed`].
    ///
    /// # Errors
    /// The crowd does not have the head; or the pose format cannot hold the mesh.
    pub fn new(
        crowd: &'a CpuCrowd,
        head: u32,
        (mesh, desc): (&PackedMesh, &UpdateDesc),
        changed: &'a [Range<u32>],
    ) -> Result<Self> {
        let group = |group: usize| {
            let grid = desc.grid(mesh.groups()[group].layout())?;
            Ok((crowd.stored_pose(head, group)?, grid.map_or([1.0; 2], |grid| grid.units)))
        };
        let (pose, units) = group(0)?;
        let masks = MaskPlace::of(mesh).map(|place| group(place.group)).transpose()?;
        Ok(Self { pose, units, changed, masks })
    }
}
