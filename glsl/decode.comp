// Writes a pose as float32 into a host buffer: positions and, if it has room for them, normals. A lane processes a
// vertex, PIECE lanes a piece of the list. CPU twin: PoseFormat::decode.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "abi.glsl"

layout(local_size_x = WORKGROUP) in;

#define OFFSETS_ID 0
#include "vertex_offsets.glsl"
#define POSES_BINDING 0
#include "pose.glsl"
layout(set = 0, binding = 1, std430) readonly buffer Pieces { uint pieces[]; };
layout(set = 0, binding = 2, std430) writeonly buffer Decoded { float decoded[]; };

layout(push_constant) uniform Push {
    vec4 units;       // input units per number of a position; in w, of a normal
    vec4 offset;      // the position of number 0
    uint pose_at;     // index of the pose's first number
    uint decoded_at;  // index of the first position
    uint stride;      // words from vertex to vertex
    uint normal_at;   // words from a position to its normal; 0: there is none
    uint vertices;
    uint count;       // pieces to write
    uint listed;      // 1: those of the list; 0: the first ones
    uint padding;     // to a multiple of 16 bytes
};
#define PIECE_AT(i) pieces[i]
#include "after.glsl"

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
    ADDEND position, normal;
    LOAD_VERTEX(poses, pose_at + VERTEX_NUMBERS * vertex, position, normal)
    uint to = decoded_at + stride * vertex;
    store(to, offset.xyz + vec3(position) * units.xyz);
    if (normal_at != 0u) {
        store(to + normal_at, vec3(normal) * units.w);
    }
}
