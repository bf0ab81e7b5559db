//! Which kernel runs: by format, kind of sums, instances and device.

use super::kernels::{Buffer, DeviceTuning};
use super::modules::{BLOCKS, BLOCKS_EXACT, CROWD, CROWD_EXACT, CROWD_EXACT_TEXELS, CROWD_TEXELS, Module};
use crate::error::Result;
use crate::pack::{DeltaFormat, PoseFormat};

/// What decides which kernel of the path `blocks` runs.
#[derive(Clone, Copy, Debug)]
pub struct BlocksCase {
    /// How deltas are stored.
    pub format: DeltaFormat,
    /// How poses are stored.
    pub pose: PoseFormat,
    /// Whether sums are exact.
    pub exact: bool,
    /// Instances that are updated together.
    pub instances: u32,
    /// Whether any target moves any block: tiles have a row at least, of some entry.
    pub entries: bool,
    /// What suits the device.
    pub device: DeviceTuning,
    /// Whether tiles are read as texels and stored in 64-bit integers, and single instances taken as tiles.
    pub texels: bool,
}

/// A kernel of the path `blocks`.
#[derive(Clone, Copy, Debug)]
pub struct BlocksChoice {
    /// The module.
    pub module: &'static Module,
    /// Widths of tiles: 1, 2, 4, … instances; 0: the kernel takes items of single instances, with masks.
    pub widths: u32,
    /// What suits the device: how wide tiles are.
    pub device: DeviceTuning,
}

impl BlocksCase {
    /// Which kernel runs.
    ///
    /// # Errors
    /// There is none for this format and kind of sums.
    pub fn choose(&self) -> Result<BlocksChoice> {
        let texels = self.texels && self.entries;
        let tiles = texels || (self.instances > 1 && self.entries);
        let kernel = match (tiles, texels, self.exact) {
            (false, _, false) => &BLOCKS,
            (false, _, true) => &BLOCKS_EXACT,
            (true, false, false) => &CROWD,
            (true, false, true) => &CROWD_EXACT,
            (true, true, false) => &CROWD_TEXELS,
            (true, true, true) => &CROWD_EXACT_TEXELS,
        };
        let widths = if tiles { self.instances.clamp(1, self.device.widest_tile).ilog2() + 1 } else { 0 };
        Ok(BlocksChoice { module: kernel.module(self.format, self.pose, 0)?, widths, device: self.device })
    }
}

impl BlocksChoice {
    /// Whether asset and list are read as texels.
    pub fn texels(&self) -> bool {
        self.module.kernel.bindings.iter().any(|(_, buffer)| *buffer == Buffer::UniformTexels)
    }

    /// Vertices of an invocation.
    pub fn lane_vertices(&self) -> u32 {
        if self.texels() { 8 } else { 1 }
    }
}
