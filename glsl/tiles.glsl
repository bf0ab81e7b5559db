// The layout of tiles and their rows in a work list: plan.comp writes it, crowd.comp reads it. src/plan/blocks/tiles.rs has
// the same.

const uint TILE = 8u;         // instances, at most
const uint ROWS = 2u;         // what the number of rows is a multiple of, where there are several instances
const uint ITEM_WORDS = 12u;  // 4, and one for each instance
// Words of a row in a tile of so many instances: an entry, a coefficient for each, and what makes rows begin at a texel
// (2, 4, 8, 12; two rows of a single instance share a texel).
#define ROW_WORDS(instances) ((((instances) + 4u) & ~3u) - 2u * (1u / (instances)))
