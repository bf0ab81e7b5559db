// A draw of direct: base pose + Σ weight · delta over the active targets, evaluated for each vertex of each draw.
// Costigan et al., Algorithm 1: zero weights are skipped, and after the last active target the loop ends.
// CPU twin: cpu::kernel::dense.
#version 450
#extension GL_GOOGLE_include_directive : require
#define DELTAS_BINDING 0
#include "dense_formats.glsl"
#include "pose.glsl"

layout(location = 0) in vec3 base_position;
layout(location = 1) in vec3 base_normal;

// For each target the coefficients of positions and normals, in quantised units.
layout(set = 0, binding = 1, std430) readonly buffer Weights { vec2 weights[]; };

layout(push_constant) uniform Push {
    uint chunk_vertices;   // vertices of the chunk: the length of a target's row
    uint target_count;
    uint active_targets;
    uint first_vertex;     // of the chunk
};

#if defined(FEEDBACK)
POSE_CAPTURE(pose_position, pose_normal)
#elif defined(STORE)
#define POSE_BINDING 2
#include "baselines/store.glsl"
#endif

void main() {
    uint vertex = uint(gl_VertexIndex);
    vec3 position = vec3(0.0);
    vec3 normal = vec3(0.0);
    uint left = active_targets;
    for (uint target = 0u; target < target_count && left > 0u; ++target) {
        vec2 weight = weights[target];
        if (weight.x == 0.0) {
            continue;
        }
        add_delta(target * chunk_vertices + vertex, weight.x, weight.y, position, normal);
        --left;
    }
    position += base_position;
    normal += base_normal;
#if defined(FEEDBACK)
    pose_position = position;
    pose_normal = normal;
#elif defined(STORE)
    store_pose(first_vertex + vertex, position, normal);
#else
    gl_Position = vec4(position + normal, 1.0);
#endif
}
