// plan.comp for GPUs: a workgroup looks at up to PLANNED_BLOCKS blocks of up to eight instances. First an invocation
// takes a block of an instance, then an entry of a block: entries of consecutive blocks are consecutive, so all have
// some. Four words are written at once, which takes GPUs much less time than one after the other.
#version 450
#extension GL_GOOGLE_include_directive : require
#define WORK_ELEMENT uvec4
#include "plan.glsl"

shared uint decided[TILE][PLANNED_BLOCKS];
shared Tile tiles[PLANNED_BLOCKS];
shared uint ends[PLANNED_BLOCKS];   // of their entries
shared uint rows[PLANNED_BLOCKS];
shared uint listed[PLANNED_BLOCKS];

// Rows of a single instance have two words, others a multiple of four. All coefficients are loaded before the first is
// stored, to wait once.
void write_row(uint row, Tile tile, uint entry, uint target, uint needed) {
#define COEFFICIENT(member) coefficient_at(tile, member, target, needed)
    uvec4 first = uvec4(entry, COEFFICIENT(0u), COEFFICIENT(1u), COEFFICIENT(2u));
    uvec4 second = uvec4(COEFFICIENT(3u), uvec3(0u)), third = uvec4(0u);
    if (WIDEST == TILE) {
        second.yzw = uvec3(COEFFICIENT(4u), COEFFICIENT(5u), COEFFICIENT(6u));
        third.x = COEFFICIENT(7u);
    }
    uint at = row / 4u;
    if (tile.width == 1u) {
        work[at][row & 2u] = first.x;
        work[at][(row & 2u) + 1u] = first.y;
        return;
    }
    work[at] = first;
    if (tile.width > 2u) work[at + 1u] = second;
    if (tile.width > 4u) work[at + 2u] = third;
}

void write_four(uint at, uvec4 words) {
    work[at / 4u] = words;
}

void main() {
    uint lane = gl_LocalInvocationID.x;
    // The host has chosen the number of workgroups: this many blocks each.
    uint most = (run_blocks + gl_NumWorkGroups.x - 1u) / gl_NumWorkGroups.x;
    uint run_block = min(gl_WorkGroupID.x * most, run_blocks);
    uint block_count = min(run_blocks - run_block, most);
    uint block = first_block + run_block;
    uint b = lane % PLANNED_BLOCKS, k = lane / PLANNED_BLOCKS;

    uint own = 0u;
    if (b < block_count && k < count_of_tile()) {
        own = decide(first_of_tile() + k, block + b);
        if ((own & OPEN) != 0u && takes_less_from_base(first_of_tile() + k, block + b)) own |= FROM_BASE;
    }
    decided[k][b] = own;
    barrier();

    if (lane < block_count) {
        Tile tile = Tile(0u, 0u, 0u);
        for (uint instance = 0u; instance < WIDEST; ++instance) add_instance(tile, instance, decided[instance][lane]);
        fill_up(tile);
        tiles[lane] = tile;
        ends[lane] = first_entry(block + lane + 1u);
        rows[lane] = rows_of(block + lane);
        listed[lane] = 0u;
    }
    barrier();

    uint of = 0u; // the block of the entry
    uint to = first_entry(block + block_count);
    for (uint e = first_entry(block) + lane; e < to; e += WORKGROUP) {
        while (e >= ends[of]) ++of;
        Tile tile = tiles[of];
        if (tile.width == 0u) continue;
        uint target = tables[entries_at + 2u * e];
        uint needed = members_that_need(tile, target);
        if (needed == 0u) continue;
        // Sums of integers do not depend on the order of rows.
        uint row = rows[of] + atomicAdd(listed[of], 1u) * ROW_WORDS(tile.width);
        write_row(row, tile, e, target, needed);
    }
    barrier();

    if (lane < block_count && tiles[lane].width != 0u) {
        append(tiles[lane], block + lane, rows[lane], listed[lane]);
    }
}
