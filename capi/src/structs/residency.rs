//! Of targets that come to the device and go.

/// Which targets come to the device and which go, counted in the mesh's order.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmTargetSwap {
    /// sizeof(DmTargetSwap).
    pub struct_size: u32,
    /// Targets to load.
    pub load_count: u32,
    /// Targets to have on the device from now on. Those that are there stay.
    pub load: *const u32,
    /// Targets whose memory others may take. Those that are not there stay away.
    pub unload: *const u32,
    /// Targets to let go.
    pub unload_count: u32,
    /// Zero.
    pub reserved: u32,
}

/// Device memory of a mesh whose targets come and go.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmResidency {
    /// sizeof(DmResidency).
    pub struct_size: u32,
    /// Not 0: targets come and go. 0: the mesh was uploaded as a whole, and what follows is 0.
    pub limited: u32,
    /// Bytes for deltas, in all: what was asked for, rounded down to whole entries, or less where all targets take
    /// less.
    pub capacity: u64,
    /// Taken by the targets that are there. The rest is free.
    pub used: u64,
    /// Bytes of the buffer: `capacity`, what says how deltas are stored, and the base pose.
    pub buffer_bytes: u64,
}
