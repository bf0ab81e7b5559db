//! What suits a kind of devices: how work is cut, and which variants of kernels are taken.

use crate::abi::numbers::TILE;
use crate::error::{Error, Result};

/// Kinds of devices, as far as kernels differ.
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

/// What suits a class of devices. [`DeviceCaps::query`](crate::DeviceCaps::query) chooses it; a host that measured its own
/// device may change fields of [`DeviceCaps::tuning`](field@crate::DeviceCaps::tuning) before it makes the engine.
/// They decide how fast updates are; poses of integers have the same bits whatever they say.
///
/// A workgroup of the path `blocks` takes a tile: one block of vertices, for up to eight instances of a crowd, for which it
/// loads each delta once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct DeviceTuning {
    /// The class.
    pub class: DeviceClass,
    /// Instances of a tile at most: 1, 2, 4 or 8. More load fewer deltas, and take more registers.
    pub widest_tile: u32,
    /// What loading and decoding an entry (the deltas of one target in one block) costs, in additions of it to one
    /// instance, 1000 at most: above 1 tiles are made of instances that have few entries in common, too. Measured on
    /// lavapipe: 3 where deltas are in the cache, 8 where they are not.
    pub load_cost: u32,
    /// Deltas are read through texel buffers (four words at a time) where their format can be, instead of storage buffers,
    /// and single instances are taken as tiles: software drivers pay for storage buffers lane by lane, and several times
    /// as much under the control flow that `masks` takes.
    pub texels: bool,
    /// Otherwise, of single instances in float32 poses only the components that change are loaded and stored: each block of
    /// a target has a mask with a bit for each of the six numbers of a vertex. Compilers for GPUs make two to three times
    /// as many instructions of that as of whole blocks.
    pub masks: bool,
    /// Invocations of a workgroup of tiles, at least, from 1 to 128: blocks of fewer vertices share one, two at most.
    pub lanes: u32,
    /// Deltas are decoded in few registers, at the price of some instructions.
    pub few_registers: bool,
}

impl DeviceTuning {
    /// For a GPU of this vendor whose subgroups have `narrowest` invocations or more. Where all of them are wider than the
    /// smallest block, a workgroup with one such block would leave the rest idle. It takes two then, and what was the same
    /// for a subgroup lies in registers of each lane: fewer have to do for decoding. VideoCore has few in any case, and
    /// runs half as many threads where a kernel takes more than 32.
    #[must_use]
    pub const fn for_gpu(self, vendor: u32, narrowest: u32) -> Self {
        const SHARED: u32 = 64;
        let wide = narrowest >= SHARED;
        Self { lanes: if wide { SHARED } else { self.lanes }, few_registers: wide || vendor == BROADCOM, ..self }
    }

    /// Refuse numbers that there are no kernels for.
    pub(crate) fn check(&self) -> Result<()> {
        let Self { widest_tile, load_cost, lanes, .. } = *self;
        let is_width = widest_tile.is_power_of_two() && widest_tile <= TILE as u32;
        if is_width && load_cost <= LOAD_COST_MAX && (1..=LANES_MAX).contains(&lanes) {
            return Ok(());
        }
        let what = format!("a DeviceTuning with widest_tile {widest_tile}, load_cost {load_cost} and lanes {lanes}");
        let remedy = format!(
            "use 1, 2, 4 or 8 for widest_tile, at most {LOAD_COST_MAX} for load_cost, and 1 to {LANES_MAX} for lanes, or \
             what DeviceClass::tuning says"
        );
        Err(Error::invalid(what, remedy))
    }
}

const BROADCOM: u32 = 0x14e4;
const LOAD_COST_MAX: u32 = 1000;
/// A workgroup that any device has.
const LANES_MAX: u32 = 128;

impl DeviceClass {
    /// What suits it.
    pub const fn tuning(self) -> DeviceTuning {
        let software = matches!(self, Self::Software);
        DeviceTuning {
            class: self,
            widest_tile: if software { 8 } else { 4 },
            load_cost: 4,
            texels: software,
            masks: software,
            lanes: 1,
            few_registers: false,
        }
    }

    /// The class of a device that is no software driver, by the vendor's PCI (or Khronos) number.
    pub const fn of_vendor(vendor: u32) -> Self {
        match vendor {
            // Arm, Imagination, Samsung, Qualcomm, Huawei.
            BROADCOM | 0x13b5 | 0x1010 | 0x144d | 0x5143 | 0x19e5 => Self::Phone,
            _ => Self::Desktop,
        }
    }
}
