// Decides what an update writes: an invocation looks at one block of up to eight instances, and writes at most one item
// of the work list for those that need it. CPU twin: update::blocks::BlockState, with fixed-point poses.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "animation.glsl"
#include "tiles.glsl"

// Most instances in a tile: fewer than TILE if kernels of wide tiles run out of registers.
layout(constant_id = 0) const uint WIDEST = TILE;

bool bit_of(uint kind, uint head, uint target) {
    return (state[bits(kind) + head * words + (target >> 5)] >> (target & 31u) & 1u) != 0u;
}

// Returns the coefficient that brings an instance's weight to a pose.
uint coefficient(uint at, bool from_base) {
    uint weight = state[weights_at + at];
    uint change = from_base ? weight : state[deltas_at + at];
    return pairs == 0u ? change : bitfieldInsert(weight, weight - change, 16, 16);
}

// Returns the k of the instance at `place` of an item.
uint head_at(uint places, uint place) {
    return places >> (4u * place) & 15u;
}

void main() {
    uint run_block = gl_GlobalInvocationID.x;
    if (run_block >= run_blocks) return;
    uint block = first_block + run_block;
    uint tile = gl_GlobalInvocationID.y;
    uint first = first_head + tile * WIDEST;
    uint count = min(group_heads - tile * WIDEST, WIDEST);

    // The instances that are written; of these, those whose targets changed, and those that start from the base pose.
    uint written = 0u, touched = 0u, rebuilt = 0u;
    for (uint k = 0u; k < count; ++k) {
        uint head = first + k;
        uint phase = state[phases_at + head * words];
        if (phase == NEW) continue;
        uint touches = 0u;
        for (uint w = 0u; w < words; ++w) {
            touches |= state[bits(CHANGED) + head * words + w] & tables[block_targets_at + block * words + w];
        }
        uint at = history_at + head * blocks + block;
        uint history = state[at];
        bool whole = phase == FIRST;
        bool touching = touches != 0u;
        uint next = (history << 1 | uint(touching || whole)) & history_mask;
        if (next != history) state[at] = next;
        uint bit = 1u << k;
        if (touching || whole || history != 0u) written |= bit;
        if (touching) touched |= bit;
        if (whole) rebuilt |= bit;
    }
    if (written == 0u) return;

    uint from = tables[first_entry_at + block];
    uint to = tables[first_entry_at + block + 1u];
    // The cost model: start from the base pose if the active entries take no more bytes than the changed ones.
    uint open = touched & ~rebuilt;
    if (always_rebuild != 0u) {
        rebuilt |= open;
    } else {
        for (uint k = 0u; k < count; ++k) {
            if ((open >> k & 1u) == 0u) continue;
            uint active_bytes = 0u, changed_bytes = 0u;
            for (uint e = from; e < to; ++e) {
                uint target = tables[entries_at + 2u * e];
                uint bytes = tables[entries_at + 2u * e + 1u];
                if (bit_of(ACTIVE, first + k, target)) active_bytes += bytes;
                if (bit_of(CHANGED, first + k, target)) changed_bytes += bytes;
            }
            if (active_bytes <= changed_bytes) rebuilt |= 1u << k;
        }
    }

    uint places = 0u, used = 0u;
    for (uint k = 0u; k < count; ++k) {
        if ((written >> k & 1u) != 0u) {
            places |= k << (4u * used);
            used += 1u;
        }
    }
    // The narrowest width that holds them; the last instance is repeated to fill it up.
    uint size = used > 4u ? 3u : (used > 2u ? 2u : used - 1u);
    uint width = 1u << size;
    uint last = head_at(places, used - 1u);
    for (uint place = used; place < TILE; ++place) places |= last << (4u * place);

    // Room for each entry, and for one row without coefficients.
    uint row_words = ROW_WORDS(width);
    uint place_of_rows = tile * (run_entries + run_blocks) + from - tables[first_entry_at + first_block] + run_block;
    uint capacity = ITEM_CAPACITY(gl_NumWorkGroups.y * run_blocks);
    uint rows = WIDTHS * TILE_WORDS * capacity + place_of_rows * ROW_WORDS(TILE);
    uint row = rows;
    for (uint e = from; e < to; ++e) {
        uint target = tables[entries_at + 2u * e];
        uint needed = 0u;
        for (uint place = 0u; place < width; ++place) {
            uint k = head_at(places, place);
            bool from_base = (rebuilt >> k & 1u) != 0u;
            if (bit_of(from_base ? ACTIVE : CHANGED, first + k, target)) needed |= 1u << place;
        }
        if (needed == 0u) continue;
        work[row] = e;
        for (uint place = 0u; place < width; ++place) {
            uint k = head_at(places, place);
            bool from_base = (rebuilt >> k & 1u) != 0u;
            uint at = (first + k) * targets + target;
            work[row + 1u + place] = (needed >> place & 1u) != 0u ? coefficient(at, from_base) : 0u;
        }
        row += row_words;
    }

    // There is at least one row: of any entry, without coefficients.
    uint listed = (row - rows) / row_words;
    if (listed == 0u) {
        listed = 1u;
        work[rows] = from < to ? from : 0u;
        for (uint place = 0u; place < TILE; ++place) work[rows + 1u + place] = 0u;
    }

    uint index = atomicAdd(control[first_counter + size], 1u);
    uint item = (size * capacity + index) * TILE_WORDS;
    uint rebuilt_places = 0u;
    for (uint place = 0u; place < TILE; ++place) {
        uint k = head_at(places, place);
        rebuilt_places |= (rebuilt >> k & 1u) << place;
        uint pose = (tile * WIDEST + k) * slots;
        work[item + 4u + place] = (pose + source) | (pose + destination) << 16;
    }
    work[item] = block;
    work[item + 1u] = rows;
    work[item + 2u] = listed;
    work[item + 3u] = rebuilt_places;
}
