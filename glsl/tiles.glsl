// The layout of tiles and their rows in a work list: plan.glsl writes it, crowd.comp reads it. Numbers:
// src/abi/numbers.rs; host: src/abi/worklist.rs.

// Words per row in a tile of this many instances: an entry, a coefficient for each, and padding, so that rows begin at
// a texel (2, 4, 8, 12; two rows of a single instance share a texel).
#define ROW_WORDS(instances) ((((instances) + 4u) & ~3u) - 2u * (1u / (instances)))

// Number of items of a width for which a work list of this many blocks has room: workgroups may process several.
#define ITEM_CAPACITY(count) (((count) + ITEMS_MAX - 1u) / ITEMS_MAX * ITEMS_MAX)
