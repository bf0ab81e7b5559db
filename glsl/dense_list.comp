// A dense compute pass over any number of targets, listed in a buffer. CPU twin: cpu::kernel::dense.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "dense.glsl"

struct Entry {
    uint target;
    float coefficient;
    float normal_coefficient;
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
    vec3 position = vec3(0.0);
    vec3 normal = vec3(0.0);
    for (uint i = 0u; i < entry_count; ++i) {
        Entry entry = entries[first_entry + i];
        uint row = entry.target * chunk_vertices + vertex;
        add_delta(row, entry.coefficient, entry.normal_coefficient, position, normal);
    }
    ADD_POSE(source_pose, vertex, position, normal)
    STORE_POSE(destination_pose, vertex, position, normal)
}
