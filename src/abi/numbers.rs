//! Numbers that shaders and host share: build.rs writes them into `abi.glsl`, which every shader may include.
//!
//! Plain data without dependencies, since build.rs includes this file.

macro_rules! shared {
    ($($(#[$doc:meta])* $name:ident = $value:expr;)*) => {
        $($(#[$doc])* pub const $name: u32 = $value;)*

        /// Every number, for GLSL.
        pub const SHARED: &[(&str, u32)] = &[$((stringify!($name), $name)),*];
    };
}

shared! {
    /// Invocations of a workgroup of every compute kernel but those of blocks.
    WORKGROUP = 64;
    /// Targets of a dense compute pass with coefficients in push constants, at most.
    DENSE_BATCH_MAX = 16;

    /// Words of an item of a work list, before its masks.
    ITEM_WORDS = 4;
    /// Set in the first word of an item that starts from the base pose.
    REBUILT = 1 << 31;
    /// Instances of a tile, at most.
    TILE = 8;
    /// Words of a tile: block, first row word, rows, which instances start from the base pose, and a word for each
    /// instance.
    TILE_WORDS = 4 + TILE;
    /// What the number of rows of a tile is a multiple of, where it has several instances.
    ROWS = 2;
    /// Words that tiles and their first rows begin at a multiple of: a texel.
    ALIGN = 4;

    /// Words of the record of a head's clip.
    RECORD_WORDS = 8;
    /// Flag of a record: a clip is playing.
    PLAYING = 1;
    /// Flag of a record: the clip starts again at its end.
    LOOP = 2;
    /// Flag of a record: the clip runs backwards.
    REVERSED = 4;
    /// Flag of a record: the head is not updated.
    HIDDEN = 8;

    /// Phase of a head: not written yet.
    NEW = 0;
    /// Phase of a head: written for the first time.
    FIRST = 1;
    /// Phase of a head: written again after it was hidden.
    SHOWN = 2;
    /// Phase of a head: written as in the update before.
    CONTINUED = 3;
    /// Phase of a head: hidden.
    SKIPPED = 4;

    /// Bits of targets: the last update changed the weight.
    CHANGED = 0;
    /// Bits of targets: the weight is not 0.
    ACTIVE = 1;
    /// Kinds of bits without an error budget.
    BIT_KINDS = 2;
    /// Bits of targets, with an error budget: the weight requested changed.
    REQUESTED = 2;
    /// Bits of targets, with an error budget: the weight requested is not the one that poses hold.
    PENDING = 3;
    /// Bits of targets, with an error budget: the change is applied.
    APPLIED = 4;
    /// Kinds of bits with an error budget.
    BIT_KINDS_BUDGET = 5;
}
