//! Numbers that shaders and host share: build.rs writes them into `abi.glsl`, which every shader may include.
//!
//! Plain data without dependencies, since build.rs includes this file.

macro_rules! shared {
    ($($(#[$doc:meta])* $name:ident: $type:ty = $value:expr;)*) => {
        $($(#[$doc])* pub const $name: $type = $value;)*

        /// Every number, for GLSL.
        pub const SHARED: &[(&str, u64)] = &[$((stringify!($name), $name as u64)),*];
    };
}

shared! {
    /// Invocations of a workgroup of every compute kernel but those of blocks.
    WORKGROUP: u32 = 64;
    /// Targets of a dense compute pass with coefficients in push constants, at most.
    DENSE_BATCH_MAX: u32 = 16;

    /// Vertices of a piece of the list of the decode step: as many as the smallest block has.
    PIECE: u32 = 32;
    /// Vertices that have bounds of their own, on their way to those of a pose: four for each lane.
    BOUNDS_PART: u32 = 256;

    /// Words of an item of a work list, before its masks.
    ITEM_WORDS: usize = 4;
    /// Set in the first word of an item that starts from the base pose.
    REBUILT: u32 = 1 << 31;
    /// Instances of a tile, at most.
    TILE: usize = 8;
    /// Widths of tiles: 2 to the power of 0, 1, 2, 3.
    WIDTHS: usize = TILE.ilog2() as usize + 1;
    /// Words of a tile: block, first row word, rows, which instances start from the base pose, and a word for each
    /// instance.
    TILE_WORDS: usize = 4 + TILE;
    /// Items of a work list that a workgroup takes, at most.
    ITEMS_MAX: u32 = 2;
    /// Words that tiles and their first rows begin at a multiple of: a texel.
    ALIGN: usize = 4;

    /// Words of the record of a head: what it plays, and where it is.
    RECORD_WORDS: u32 = 16;
    /// Flag of a record: a clip is playing.
    PLAYING: u32 = 1;
    /// Flag of a record: the clip starts again at its end.
    LOOP: u32 = 2;
    /// Flag of a record: the clip runs backwards.
    REVERSED: u32 = 4;
    /// Flag of a record: the head is not updated.
    HIDDEN: u32 = 8;
    /// Flag of a record: the head keeps no more targets than its size on the screen needs.
    FOLLOWS: u32 = 16;
    /// Words of a head's level of detail: targets kept, goal, epoch, two words of the error budget.
    LEVEL_WORDS: u32 = 5;

    /// Phase of a head: not written, since it is hidden, or not yet.
    NEW: u32 = 0;
    /// Phase of a head: written for the first time, or again after it was hidden. No slot that updates read holds its
    /// pose.
    FIRST: u32 = 1;
    /// Phase of a head: written as in the update before.
    CONTINUED: u32 = 2;

    /// Bits of targets: the last update changed the weight.
    CHANGED: u32 = 0;
    /// Bits of targets: the weight is not 0.
    ACTIVE: u32 = 1;
    /// Kinds of bits without an error budget.
    BIT_KINDS: u32 = 2;
    /// Bits of targets, with an error budget: the weight requested changed.
    REQUESTED: u32 = 2;
    /// Bits of targets, with an error budget: the weight requested is not the one that poses hold.
    PENDING: u32 = 3;
    /// Bits of targets, with an error budget: the change is applied.
    APPLIED: u32 = 4;
    /// Kinds of bits with an error budget.
    BIT_KINDS_BUDGET: u32 = 5;
}
