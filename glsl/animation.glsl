// Shared by the kernels of animation on the GPU: bindings, push constants, layouts. All words have 32 bits. Numbers:
// src/abi/numbers.rs. Host: src/update/animated/layout.rs. Times and keys: src/update/animated/sample.rs.

#include "abi.glsl"

layout(local_size_x = WORKGROUP) in;

// clips    [clip][first word, frames, shift, bits of a key], keys
// levels   [target] rank
// blocks   [block][word] bits of the targets that touch it;   [block + 1] first entry;   [entry] target, bytes
layout(set = 0, binding = 0, std430) readonly buffer Tables { uint tables[]; };

// records  [instance] RECORD_WORDS words, written by copies
// phases   [instance][word]; the first word of an instance is its phase
// weights  [instance][target] in steps of the grid;   deltas [instance][target]: what the last update changed
// bits     [CHANGED..][instance][word] of 32 targets, a bit each
// history  [instance][block]: a bit for each of the last updates that touched it, the last in bit 0
layout(set = 0, binding = 1, std430) buffer State { uint state[]; };

// items    [width][item] TILE_WORDS words;   rows [tile][entry, and one for each block]     (tiles.glsl)
// Each set of instances and run of blocks has its own. A kernel may define the element: a word, or four.
#ifndef WORK_ELEMENT
#define WORK_ELEMENT uint
#endif
layout(set = 0, binding = 2, std430) buffer Work { WORK_ELEMENT work[]; };

// counters [set][run][width], then arguments [set][run][width][chunk] x y z of a dispatch
layout(set = 0, binding = 3, std430) buffer Control { uint control[]; };

layout(push_constant) uniform Push {
    uint now;              // tick
    uint instances;            // of the crowd
    uint targets;
    uint words;            // with a bit for each target
    uint blocks;
    uint block_targets_at; // in Tables
    uint first_entry_at;
    uint entries_at;
    uint phases_at;        // in State
    uint weights_at;
    uint deltas_at;
    uint bits_at;
    uint history_at;
    uint history_mask;     // bits of the updates that a slot may lack
    uint slots;
    uint source;           // slots
    uint destination;
    uint always_rebuild;   // touched blocks start from the base pose
    uint first_instance;       // of the set that is planned for
    uint group_instances;
    uint first_block;      // of the run that is planned for
    uint run_blocks;
    uint run_entries;
    uint first_counter;
    uint counters;
    uint chunks;           // dispatches of a width
    uint chunk_workgroups; // of a dispatch, at most
    uint pairs;            // rows have the weight that a pose holds and the new one, 16 bits each
    uint workgroup_items;  // items that a workgroup takes
};

uint bits(uint kind) {
    return bits_at + kind * instances * words;
}

// Dispatches have two dimensions, since one may not hold all invocations.
uint flat_invocation() {
    return gl_GlobalInvocationID.x + gl_GlobalInvocationID.y * gl_NumWorkGroups.x * gl_WorkGroupSize.x;
}
