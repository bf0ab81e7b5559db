//! Tuning by kind of device: how work is divided, and which variants of kernels run.

use ash::vk;

use crate::abi::numbers::{PLANNED_BLOCKS, TILE, WORKGROUP};
use crate::error::{Result, ensure};

/// Kinds of devices between which kernels differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum DeviceClass {
    /// A driver that runs on the CPU.
    Software,
    /// A GPU of a phone, a tablet or a small board.
    Phone,
    /// Any other GPU.
    Desktop,
}

/// Tuning for a class of devices. [`DeviceCaps::query`](crate::DeviceCaps::query) chooses it; a host that has measured
/// its own device may change fields of [`DeviceCaps::tuning`](crate::DeviceCaps::tuning) before it makes the
/// engine. The values affect speed only; fixed-point poses have the same bits whatever they are.
///
/// A workgroup of the path `blocks` processes a tile: one block of vertices, for up to eight instances of a crowd, so
/// that it loads each delta once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct DeviceTuning {
    /// The class.
    pub class: DeviceClass,
    /// Most instances in a tile: 1, 2, 4 or 8. Wider tiles load fewer deltas and need more registers.
    pub widest_tile: u32,
    /// Cost of loading and decoding an entry (the deltas of one target in one block), in units of adding it to one
    /// instance; at most 1000. Above 1, instances with few common entries share tiles, too. Measured on lavapipe: 3 for
    /// deltas in the cache, 8 for others.
    pub load_cost: u32,
    /// Whether deltas are read through texel buffers (four words at a time) instead of storage buffers, if their format
    /// allows it. On software drivers storage buffers are accessed lane by lane.
    pub texels: bool,
    /// Fewest invocations in a workgroup of tiles, from 1 to 128: smaller blocks share a workgroup, at most two in one.
    pub lanes: u32,
    /// Whether deltas are decoded in few registers, at the price of some instructions.
    pub few_registers: bool,
    /// Whether the invocations of a workgroup plan animated crowds together, through shared memory and barriers.
    /// Otherwise each works alone: software drivers take 4 to 8 times as long with barriers.
    pub plans_together: bool,
}

impl DeviceTuning {
    /// Adjusts the tuning to a GPU of this vendor whose subgroups have at least `narrowest` invocations. If all
    /// subgroups are wider than the smallest block, a workgroup with one such block would leave lanes idle. It takes
    /// two blocks then, and values that were uniform in a subgroup take registers in each lane, so fewer are left for
    /// decoding. VideoCore has few registers in any case, and runs half as many threads if a kernel needs more than 32.
    /// NVIDIA's have enough for wide tiles, with which an H200 took 15% less time for blocks where all weights change.
    #[must_use]
    pub const fn for_gpu(self, vendor: u32, narrowest: u32) -> Self {
        const SHARED: u32 = 64;
        let wide = narrowest >= SHARED;
        Self {
            widest_tile: if vendor == NVIDIA { TILE as u32 } else { self.widest_tile },
            lanes: if wide { SHARED } else { self.lanes },
            few_registers: wide || vendor == BROADCOM,
            ..self
        }
    }

    /// Adjusts the tuning to a software driver, by its vendor and its version of Vulkan, the one number from which
    /// lavapipe's own follows. Mesa 25.0.7 with LLVM 19 crashes now and then in kernels that read texels: the results
    /// of its fetches are misaligned on the stack. Mesa 22.3 and 26.2 do not; versions between 22.3 and 26.2 are
    /// assumed to crash like 25.0.7.
    #[must_use]
    pub(crate) fn for_software(self, vendor: u32, api_version: u32) -> Self {
        let mesa_22_3 = vk::make_api_version(0, 1, 3, 230);
        let mesa_26_2 = vk::make_api_version(0, 1, 4, 354);
        let crashes = vendor == MESA && mesa_22_3 < api_version && api_version < mesa_26_2;
        Self { texels: self.texels && !crashes, ..self }
    }

    /// Invocations that sample 32 targets of an instance.
    pub(crate) const fn sampling_lanes(&self) -> u32 {
        if self.plans_together { 32 } else { 1 }
    }

    /// Fewest and most blocks that a workgroup plans for a tile.
    pub(crate) const fn planned_blocks(&self) -> [u32; 2] {
        if self.plans_together { [1, PLANNED_BLOCKS] } else { [WORKGROUP; 2] }
    }

    /// Checks that there are kernels for these values.
    pub(crate) fn check(&self) -> Result<()> {
        let Self { widest_tile, load_cost, lanes, .. } = *self;
        let is_width = widest_tile.is_power_of_two() && widest_tile <= TILE as u32;
        let what = format!("a DeviceTuning with widest_tile {widest_tile}, load_cost {load_cost} and lanes {lanes}");
        let remedy = format!(
            "use 1, 2, 4 or 8 for widest_tile, at most {LOAD_COST_MAX} for load_cost, and 1 to {LANES_MAX} for lanes, \
             or start from DeviceClass::tuning"
        );
        ensure!(is_width && load_cost <= LOAD_COST_MAX && (1..=LANES_MAX).contains(&lanes), what, remedy);
        Ok(())
    }
}

const BROADCOM: u32 = 0x14e4;
const NVIDIA: u32 = 0x10de;
const MESA: u32 = 0x10005;
const LOAD_COST_MAX: u32 = 1000;
/// A workgroup size that every device supports.
const LANES_MAX: u32 = 128;

impl DeviceClass {
    /// Returns the tuning for this class.
    pub const fn tuning(self) -> DeviceTuning {
        let software = matches!(self, Self::Software);
        DeviceTuning {
            class: self,
            widest_tile: if software { 8 } else { 4 },
            load_cost: 4,
            texels: software,
            lanes: 1,
            few_registers: false,
            plans_together: !software,
        }
    }

    /// Returns the class of a hardware device by its vendor's PCI (or Khronos) number.
    pub const fn of_vendor(vendor: u32) -> Self {
        match vendor {
            // Arm, Imagination, Samsung, Qualcomm, Huawei.
            BROADCOM | 0x13b5 | 0x1010 | 0x144d | 0x5143 | 0x19e5 => Self::Phone,
            _ => Self::Desktop,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_of_lavapipe_that_crash_read_no_texels() {
        let texels = |vendor, minor, patch| {
            DeviceClass::Software.tuning().for_software(vendor, vk::make_api_version(0, 1, minor, patch)).texels
        };
        assert!(texels(MESA, 3, 230) && texels(MESA, 4, 354), "Mesa 22.3 and 26.2");
        assert!(!texels(MESA, 4, 305), "Mesa 25.0");
        assert!(texels(0x1ae0, 3, 280), "SwiftShader");
    }
}
