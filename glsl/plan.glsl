// What both planners decide: what an update does to a block of an instance, which instances share a tile, and what its
// rows say. They differ in which invocation does it, and in how they write. CPU twin: update::blocks::BlockState, with
// fixed-point poses.

#include "animation.glsl"
#include "tiles.glsl"

// Most instances in a tile: fewer than TILE if kernels of wide tiles run out of registers.
layout(constant_id = 0) const uint WIDEST = TILE;

// What an update does to a block of an instance. 0: nothing.
const uint WRITTEN = 1u;
const uint FROM_BASE = 2u; // it is written, starting from the base pose,
const uint OPEN = 4u;      // or if that takes less

// The instances of a tile are those from this one on...
uint first_of_tile() {
    return first_instance + gl_GlobalInvocationID.y * WIDEST;
}

// ... of which there are this many.
uint count_of_tile() {
    return min(group_instances - gl_GlobalInvocationID.y * WIDEST, WIDEST);
}

uint first_entry(uint block) {
    return tables[first_entry_at + block];
}

uint bits_of(uint kind, uint instance, uint word) {
    return state[bits(kind) + instance * words + word];
}

bool bit_of(uint kind, uint instance, uint target) {
    return (bits_of(kind, instance, target >> 5) >> (target & 31u) & 1u) != 0u;
}

// Decides what to do to a block of an instance, and notes in its history that it was touched.
uint decide(uint instance, uint block) {
    uint phase = state[phases_at + instance * words];
    if (phase == NEW) return 0u;
    uint touches = 0u;
    for (uint w = 0u; w < words; ++w) {
        touches |= bits_of(CHANGED, instance, w) & tables[block_targets_at + block * words + w];
    }
    uint at = history_at + instance * blocks + block;
    uint history = state[at];
    bool whole = phase == FIRST;
    bool touched = touches != 0u;
    uint next = (history << 1 | uint(touched || whole)) & history_mask;
    if (next != history) state[at] = next;
    bool from_base = whole || touched && always_rebuild != 0u;
    return from_base ? WRITTEN | FROM_BASE : touched ? WRITTEN | OPEN : history != 0u ? WRITTEN : 0u;
}

// The cost model: whether the active entries of a block take no more bytes than the changed ones.
bool takes_less_from_base(uint instance, uint block) {
    // Each entry has bytes, so they count only if some targets are active and have not changed, and others have changed
    // and are not active.
    uint kept = 0u, ended = 0u;
    for (uint w = 0u; w < words; ++w) {
        uint active_bits = bits_of(ACTIVE, instance, w), changed = bits_of(CHANGED, instance, w);
        uint either = (active_bits ^ changed) & tables[block_targets_at + block * words + w];
        kept |= either & active_bits;
        ended |= either & changed;
    }
    if (kept == 0u || ended == 0u) return kept == 0u;

    uint active_bytes = 0u, changed_bytes = 0u;
    uint to = first_entry(block + 1u);
    for (uint e = first_entry(block); e < to; ++e) {
        uint target = tables[entries_at + 2u * e];
        uint bytes = tables[entries_at + 2u * e + 1u];
        if (bit_of(ACTIVE, instance, target)) active_bytes += bytes;
        if (bit_of(CHANGED, instance, target)) changed_bytes += bytes;
    }
    return active_bytes <= changed_bytes;
}

// A tile: its width (0: none), for each member the instance's number of four bits, and a bit if that starts from the
// base pose.
struct Tile {
    uint width;
    uint instances;
    uint rebuilt;
};

// Adds an instance, if it is written.
void add_instance(inout Tile tile, uint instance, uint decided) {
    if (decided == 0u) return;
    tile.instances |= instance << (4u * tile.width);
    tile.rebuilt |= uint((decided & FROM_BASE) != 0u) << tile.width;
    tile.width += 1u;
}

uint instance_at(Tile tile, uint member) {
    return tile.instances >> (4u * member) & 15u;
}

bool is_rebuilt(Tile tile, uint member) {
    return (tile.rebuilt >> member & 1u) != 0u;
}

// log2 of the narrowest width that holds this many instances.
uint size_of(uint used) {
    return used > 4u ? 3u : used > 2u ? 2u : used - 1u;
}

// Widens a tile to the next width; the last instance is repeated to fill it up.
void fill_up(inout Tile tile) {
    uint used = tile.width;
    if (used == 0u) return;
    uint last = instance_at(tile, used - 1u);
    uint last_rebuilt = tile.rebuilt >> (used - 1u);
    for (uint member = used; member < TILE; ++member) {
        tile.instances |= last << (4u * member);
        tile.rebuilt |= last_rebuilt << member;
    }
    tile.width = 1u << size_of(used);
}

// Members of a tile that need an entry.
uint members_that_need(Tile tile, uint target) {
    uint needed = 0u;
    for (uint member = 0u; member < tile.width; ++member) {
        uint kind = is_rebuilt(tile, member) ? ACTIVE : CHANGED;
        if (bit_of(kind, first_of_tile() + instance_at(tile, member), target)) needed |= 1u << member;
    }
    return needed;
}

// Returns the coefficient that brings an instance's weight to a pose.
uint coefficient(uint at, bool from_base) {
    uint weight = state[weights_at + at];
    uint change = from_base ? weight : state[deltas_at + at];
    return pairs == 0u ? change : bitfieldInsert(weight, weight - change, 16, 16);
}

// The coefficient of a member in a row: 0 if it does not need the entry.
uint coefficient_at(Tile tile, uint member, uint target, uint needed) {
    if ((needed >> member & 1u) == 0u) return 0u;
    uint at = (first_of_tile() + instance_at(tile, member)) * targets + target;
    return coefficient(at, is_rebuilt(tile, member));
}

// A planner defines how it writes a row from word `row` on, and four words of an item.
void write_row(uint row, Tile tile, uint entry, uint target, uint needed);
void write_four(uint at, uvec4 words);

uint item_capacity() {
    return ITEM_CAPACITY(gl_NumWorkGroups.y * run_blocks);
}

// The first row of a block. There is room for each entry, and for one row without coefficients.
uint rows_of(uint block) {
    uint before = first_entry(block) - first_entry(first_block) + block - first_block;
    uint member = gl_GlobalInvocationID.y * (run_entries + run_blocks) + before;
    return WIDTHS * TILE_WORDS * item_capacity() + member * ROW_WORDS(TILE);
}

// The poses that a member reads and writes.
uint slots_at(Tile tile, uint member) {
    uint first = (gl_GlobalInvocationID.y * WIDEST + instance_at(tile, member)) * slots;
    return (first + source) | (first + destination) << 16;
}

// Appends a tile with `listed` rows to the list of its width.
void append(Tile tile, uint block, uint rows, uint listed) {
    // There is at least one row: of any entry, without coefficients.
    if (listed == 0u) {
        listed = 1u;
        uint from = first_entry(block);
        write_row(rows, tile, from < first_entry(block + 1u) ? from : 0u, 0u, 0u);
    }
    uint size = size_of(tile.width);
    uint index = atomicAdd(control[first_counter + size], 1u);
    uint item = (size * item_capacity() + index) * TILE_WORDS;
    write_four(item, uvec4(block, rows, listed, tile.rebuilt));
    for (uint member = 0u; member < TILE; member += 4u) {
        uvec2 two = uvec2(slots_at(tile, member), slots_at(tile, member + 1u));
        write_four(item + 4u + member, uvec4(two, slots_at(tile, member + 2u), slots_at(tile, member + 3u)));
    }
}
