// A dense compute pass over BATCH targets named in push constants: pose = source + Σ coefficient · delta.
// CPU twin: cpu::kernel::dense.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "dense.glsl"

layout(constant_id = 0) const uint BATCH = 1;

layout(push_constant) uniform Push {
    uint chunk_vertices;   // vertices of the chunk: the length of a target's row
    float coefficients[DENSE_BATCH_MAX];
    uint targets[DENSE_BATCH_MAX / 2]; // two 16-bit indices to a word
    uint normal_exponents[DENSE_BATCH_MAX / 4];
};

void main() {
    // Vertices are padded to whole workgroups: no invocation is idle.
    uint vertex = gl_GlobalInvocationID.x;
    vec3 position = vec3(0.0);
    vec3 normal = vec3(0.0);
    for (uint i = 0u; i < BATCH; ++i) {
        uint target = bitfieldExtract(targets[i >> 1], int(16u * (i & 1u)), 16);
        float ratio = normal_ratio(normal_exponents[i >> 2], i);
        add_delta(target * chunk_vertices + vertex, coefficients[i], coefficients[i] * ratio, position, normal);
    }
    ADD_POSE(source_pose, vertex, position, normal)
    STORE_POSE(destination_pose, vertex, position, normal)
}
