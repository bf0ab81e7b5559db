// The bounds of parts of a pose: a workgroup processes a part of BOUNDS_PART vertices. bounds_total.comp combines them.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "abi.glsl"
#define POSE_WITHOUT_INPUTS
#include "host/pose.glsl"

layout(local_size_x = WORKGROUP) in;

#define PLACES_ID 0
#include "places.glsl"
#define POSES_BINDING 0
#include "pose.glsl"
layout(set = 0, binding = 1, std430) readonly buffer Base { float base[]; };
layout(set = 0, binding = 2, std430) readonly buffer Pieces { uint pieces[]; };
// Six numbers per part: least and greatest coordinates.
layout(set = 0, binding = 3, std430) writeonly buffer Parts { float parts[]; };

layout(push_constant) uniform Push {
    uint pose_at;     // index of the pose's first number
    uint base_at;     // index of the base pose's first number
    uint vertices;
    uint listed;      // 1: parts of the list; 0: the first ones
    vec2 units;       // input units of integers: positions, normals
};
#include "extent.glsl"

vec3 position_of(uint vertex) {
    uint at = 6u * vertex;
    ADDEND position, normal;
    LOAD_VERTEX(poses, pose_at + VERTEX_NUMBERS * vertex, position, normal)
    at += base_at;
    return POSE_DECODED(position, vec3(base[at], base[at + 1u], base[at + 2u]), units.x);
}

void main() {
    uint part = listed != 0u ? pieces[gl_WorkGroupID.x] : gl_WorkGroupID.x;
    uint first = part * BOUNDS_PART + gl_LocalInvocationID.x;
    // Lanes beyond the last vertex repeat it.
    vec3 low = position_of(min(first, vertices - 1u));
    vec3 high = low;
    // Not unrolled: the positions of all iterations at once would take too many registers.
    [[dont_unroll]] for (uint i = WORKGROUP; i < BOUNDS_PART; i += WORKGROUP) {
        vec3 position = position_of(min(first + i, vertices - 1u));
        low = min(low, position);
        high = max(high, position);
    }
    reduce(low, high);
    if (gl_LocalInvocationID.x == 0u) {
        uint at = 6u * part;
        parts[at] = low.x;
        parts[at + 1u] = low.y;
        parts[at + 2u] = low.z;
        parts[at + 3u] = high.x;
        parts[at + 4u] = high.y;
        parts[at + 5u] = high.z;
    }
}
