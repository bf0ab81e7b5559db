// Decides what an update writes: an invocation looks at one block of up to eight instances, and writes at most one item
// of the work list for those that need it. For software drivers; GPUs run plan_together.comp.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "plan.glsl"

void write_row(uint row, Tile tile, uint entry, uint target, uint needed) {
    work[row] = entry;
    for (uint member = 0u; member < tile.width; ++member) {
        work[row + 1u + member] = coefficient_at(tile, member, target, needed);
    }
}

void write_four(uint at, uvec4 words) {
    for (uint i = 0u; i < 4u; ++i) work[at + i] = words[i];
}

void main() {
    uint run_block = gl_GlobalInvocationID.x;
    if (run_block >= run_blocks) return;
    uint block = first_block + run_block;

    // Four bits an instance.
    uint decided = 0u;
    uint count = count_of_tile();
    for (uint k = 0u; k < count; ++k) decided |= decide(first_of_tile() + k, block) << (4u * k);
    if (decided == 0u) return;
    Tile tile = Tile(0u, 0u, 0u);
    for (uint k = 0u; k < count; ++k) {
        uint own = decided >> (4u * k) & 15u;
        if ((own & OPEN) != 0u && takes_less_from_base(first_of_tile() + k, block)) own |= FROM_BASE;
        add_instance(tile, k, own);
    }
    fill_up(tile);

    uint rows = rows_of(block), listed = 0u;
    uint to = first_entry(block + 1u);
    for (uint e = first_entry(block); e < to; ++e) {
        uint target = tables[entries_at + 2u * e];
        uint needed = members_that_need(tile, target);
        if (needed == 0u) continue;
        write_row(rows + listed * ROW_WORDS(tile.width), tile, e, target, needed);
        listed += 1u;
    }
    append(tile, block, rows, listed);
}
