// Writes a pose as float32 into a host buffer: positions and, if it has room for them, normals. A lane processes a
// vertex, PIECE lanes a piece of the list. CPU twin: PoseFormat::decode.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "abi.glsl"
#define POSE_WITHOUT_INPUTS
#include "host/pose.glsl"

layout(local_size_x = WORKGROUP) in;

const uint NUMBERS = 6u;
#define PLACES_ID 0
#include "places.glsl"
#define POSES_BINDING 0
#include "pose.glsl"
layout(set = 0, binding = 1, std430) readonly buffer Base { float base[]; };
layout(set = 0, binding = 2, std430) readonly buffer Pieces { uint pieces[]; };
layout(set = 0, binding = 3, std430) writeonly buffer Decoded { float decoded[]; };

layout(push_constant) uniform Push {
    uint pose_at;     // index of the pose's first number
    uint base_at;     // index of the base pose's first number
    uint decoded_at;  // index of the first position
    uint stride;      // words from vertex to vertex
    uint normal_at;   // words from a position to its normal; 0: there is none
    uint vertices;
    uint count;       // pieces to write
    uint listed;      // 1: those of the list; 0: the first ones
    vec2 units;       // input units of integers: positions, normals
};
#define PIECE_AT(i) pieces[i]
#include "after.glsl"

vec3 base_of(uint at) {
    return vec3(base[base_at + at], base[base_at + at + 1u], base[base_at + at + 2u]);
}

void store(uint at, vec3 value) {
    decoded[at] = value.x;
    decoded[at + 1u] = value.y;
    decoded[at + 2u] = value.z;
}

void main() {
    uint vertex = vertex_of_lane();
    if (vertex >= vertices) {
        return;
    }
    uint at = NUMBERS * vertex;
    ADDEND position, normal;
    LOAD_VERTEX(poses, pose_at + VERTEX_NUMBERS * vertex, position, normal)
    uint to = decoded_at + stride * vertex;
    store(to, POSE_DECODED(position, base_of(at), units.x));
    if (normal_at != 0u) {
        store(to + normal_at, POSE_DECODED(normal, base_of(at + 3u), units.y));
    }
}
