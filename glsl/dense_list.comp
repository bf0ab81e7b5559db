// A dense compute pass over any number of targets, listed in a buffer. CPU twin: cpu::kernel::dense.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "dense.glsl"

struct Entry {
    uint target;
    uint coefficient;        // a float32; for fixed-point poses the weight to hold
    uint normal_coefficient; // a float32; for fixed-point poses the weight that the source holds
    uint dropped;            // lowest bits of products: of positions, and in bits 8..16 of normals
};
layout(set = 0, binding = 3, std430) readonly buffer Entries { Entry entries[]; };

layout(push_constant) uniform Push {
    uint chunk_vertices;   // vertices of the chunk: the length of a target's row
    uint first_entry;
    uint entry_count;
};

void main() {
    // Vertices are padded to whole workgroups: no invocation is idle.
    uint vertex = gl_GlobalInvocationID.x;
    ADDEND position = ADDEND(0);
    ADDEND normal = ADDEND(0);
    for (uint i = 0u; i < entry_count; ++i) {
        Entry entry = entries[first_entry + i];
        uint row = entry.target * chunk_vertices + vertex;
#ifdef INTEGER_POSES
        ivec2 weights = ivec2(entry.coefficient, entry.normal_coefficient);
        add_rounded(row, weights, entry.dropped, position, normal);
#else
        add_delta(row, uintBitsToFloat(entry.coefficient), uintBitsToFloat(entry.normal_coefficient), position, normal);
#endif
    }
    ADD_POSE(source_pose, vertex, position, normal)
    STORE_POSE(destination_pose, vertex, position, normal)
}
