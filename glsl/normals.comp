// Normals of the morphed surface, written into a host buffer: for each vertex the sum of the area vectors of its
// triangles, as on import, with unit length. A lane processes a vertex, PIECE lanes a piece of the list. Float64:
// src/after/normals/mod.rs.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "abi.glsl"

layout(local_size_x = WORKGROUP) in;

#define OFFSETS_ID 0
#include "vertex_offsets.glsl"
#define POSES_BINDING 0
#include "pose.glsl"
// For each vertex: the base pose, six numbers; and from fans_at on the position of its fan. A fan: triangles, their
// common vertex, and for each triangle the other two, in order.
layout(set = 0, binding = 1, std430) readonly buffer Asset { uint asset[]; };
layout(set = 0, binding = 2, std430) readonly buffer Pieces { uint pieces[]; };
layout(set = 0, binding = 3, std430) writeonly buffer Normals { float normals[]; };

layout(push_constant) uniform Push {
    vec4 units;       // input units per number of a position; in w, of a normal
    vec4 offset;      // the position of number 0
    uint pose_at;     // index of the pose's first number
    uint fans_at;     // word with the position of the first vertex's fan
    uint normals_at;  // index of the first normal
    uint stride;      // words from vertex to vertex
    uint vertices;
    uint count;       // pieces to write
    uint listed;      // 1: those of the list; 0: the first ones
    uint padding;     // to a multiple of 16 bytes
};
#define PIECE_AT(i) pieces[i]
#include "after.glsl"

vec3 base_of(uint at) {
    return uintBitsToFloat(uvec3(asset[at], asset[at + 1u], asset[at + 2u]));
}

vec3 position_of(uint vertex) {
    ADDEND position, normal;
    LOAD_VERTEX(poses, pose_at + VERTEX_NUMBERS * vertex, position, normal)
    return offset.xyz + vec3(position) * units.xyz;
}

void main() {
    uint vertex = vertex_of_lane();
    if (vertex >= vertices) {
        return;
    }
    uint fan = asset[fans_at + vertex];
    uint end = fan + 2u + 2u * asset[fan];
    vec3 from = position_of(asset[fan + 1u]);
    vec3 sum = vec3(0.0);
    for (uint at = fan + 2u; at < end; at += 2u) {
        sum += cross(position_of(asset[at]) - from, position_of(asset[at + 1u]) - from);
    }
    // Scaled first, since the squares of small areas would vanish in single precision.
    float most = max(max(abs(sum.x), abs(sum.y)), abs(sum.z));
    if (most > 0.0) {
        sum = normalize(sum / most);
    } else {
        sum = base_of(6u * vertex + 3u);
    }
    uint to = normals_at + stride * vertex;
    normals[to] = sum.x;
    normals[to + 1u] = sum.y;
    normals[to + 2u] = sum.z;
}
