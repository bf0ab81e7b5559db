//! Numbers shared by shaders and host: build.rs writes them into `abi.glsl`.
//!
//! build.rs includes this file, so it is plain data without dependencies.

macro_rules! shared {
    ($($(#[$doc:meta])* $name:ident: $type:ty = $value:expr;)*) => {
        $($(#[$doc])* pub const $name: $type = $value;)*

        /// All numbers, for GLSL.
        pub const SHARED: &[(&str, u64)] = &[$((stringify!($name), $name as u64)),*];
    };
}

shared! {
    /// Workgroup size of all compute kernels except those of blocks.
    WORKGROUP: u32 = 64;
    /// Most targets of a dense compute pass with coefficients in push constants.
    DENSE_BATCH_MAX: u32 = 16;

    /// Vertices of a piece, the unit in which post-morph passes list changes: the smallest block size.
    PIECE: u32 = 32;

    /// Format of an output: three float32 numbers of unit length. Formats 1 to 4 are as many float32 numbers; 0: none.
    UNIT_FLOATS: u32 = 5;
    /// Format of an output: three of four SNORM numbers of 16 bits.
    SNORM16: u32 = 6;
    /// Format of an output: three of four SNORM numbers of 8 bits.
    SNORM8: u32 = 7;
    /// Format of an output: three SNORM numbers of 10 bits in the lower bits of a word.
    SNORM10: u32 = 8;

    /// Most instances of a tile.
    TILE: usize = 8;
    /// Number of tile widths: 1, 2, 4, 8.
    WIDTHS: usize = TILE.ilog2() as usize + 1;
    /// Words of a tile: block, first row word, number of rows, mask of instances that start from the base pose, then a
    /// word per instance.
    TILE_WORDS: usize = 4 + TILE;
    /// Most work-list items per workgroup.
    ITEMS_MAX: u32 = 2;
    /// Alignment of tiles and their first rows, in words: one texel.
    ALIGN: usize = 4;

    /// Most blocks that a workgroup plans for a tile: an invocation for each of the tile's instances.
    PLANNED_BLOCKS: u32 = WORKGROUP / TILE as u32;

    /// Words of an instance's record: what it plays, and how many targets it keeps.
    RECORD_WORDS: u32 = 8;
    /// Record flag: a clip is playing.
    PLAYING: u32 = 1;
    /// Record flag: the clip loops.
    LOOP: u32 = 2;
    /// Record flag: the clip runs backwards.
    REVERSED: u32 = 4;
    /// Record flag: the instance is not updated.
    HIDDEN: u32 = 8;

    /// Phase of an instance: not written, since it is hidden or was never updated.
    NEW: u32 = 0;
    /// Phase of an instance: written for the first time, or again after it was hidden; no slot that updates read holds
    /// its pose.
    FIRST: u32 = 1;
    /// Phase of an instance: written in this update and the one before.
    CONTINUED: u32 = 2;

    /// Target bits: the last update changed the weight.
    CHANGED: u32 = 0;
    /// Target bits: the weight is not 0.
    ACTIVE: u32 = 1;
    /// Number of bit kinds.
    BIT_KINDS: u32 = 2;
}
