//! Where the poses of a picture come from.

use crate::wrinkles::MaskPlace;
use deltamorph::{CpuCrowd, PackedMesh, Result, UpdateDesc};
use std::ops::Range;

/// Where the poses of a picture come from.
#[derive(Clone, Copy, Debug)]
pub enum Poses<'a> {
    /// Of the crowd, which is asked for these weights: those of each head.
    Weights(&'a [&'a [f32]]),
    /// From the host: that of each head.
    Stored(&'a [StoredPose<'a>]),
}

/// A pose of the host's.
#[derive(Clone, Copy, Debug)]
pub struct StoredPose<'a> {
    /// As its format stores it.
    pub pose: &'a [u8],
    /// [`PoseView::units`](deltamorph::PoseView::units); 1 of float32 poses.
    pub units: [f32; 2],
    /// The vertices that changed.
    pub changed: &'a [Range<u32>],
    /// For [`Show::Wrinkles`](crate::Show::Wrinkles), the pose of the group that has the masks ([`MaskPlace::group`](crate::wrinkles::MaskPlace)), and its units.
    pub masks: Option<(&'a [u8], [f32; 2])>,
}

impl<'a> StoredPose<'a> {
    /// Of a head of a crowd on the path `cpu`, which updates `mesh` as `desc` says; `changed`: [`CpuCrowd::changed`].
    ///
    /// # Errors
    /// A head that the crowd does not have; poses that cannot hold the mesh.
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
