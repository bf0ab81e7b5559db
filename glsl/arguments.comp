// Converts the number of items in each work list to the number of workgroups to dispatch, and resets the counters to 0.
// The last workgroup is filled up with items without rows. For lists written by the CPU, src/update/blocks/dispatch.rs
// does this.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "animation.glsl"
#include "tiles.glsl"

// Most instances in a tile, as in plan.glsl.
layout(constant_id = 0) const uint WIDEST = TILE;

void main() {
    uint size = gl_LocalInvocationID.x;
    if (size >= WIDTHS) return;
    uint counter = first_counter + size;
    uint count = control[counter];
    control[counter] = 0u;
    uint workgroups = (count + workgroup_items - 1u) / workgroup_items;
    uint first = size * ITEM_CAPACITY((group_instances + WIDEST - 1u) / WIDEST * run_blocks);
    for (uint i = count; i < workgroups * workgroup_items; ++i) work[(first + i) * TILE_WORDS + 2u] = 0u;
    for (uint chunk = 0u; chunk < chunks; ++chunk) {
        uint at = counters + 3u * (counter * chunks + chunk);
        control[at] = min(workgroups, chunk_workgroups);
        control[at + 1u] = 1u;
        control[at + 2u] = 1u;
        workgroups -= min(workgroups, chunk_workgroups);
    }
}
