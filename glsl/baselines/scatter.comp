// scatter: a thread for each delta of one target adds weight · delta to the sums of its vertex.
// CPU twin: cpu::blocks, exact sums.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "abi.glsl"

layout(local_size_x = WORKGROUP) in;

// A vertex, and three words of a position component (18 bits) and a normal component (14 bits).
layout(set = 0, binding = 0, std430) readonly buffer Records { uvec4 records[]; };
layout(set = 0, binding = 1, std430) buffer Sums { int sums[]; };

layout(push_constant) uniform Push {
    uint first;   // record
    uint count;
    int weight;   // on the grid of exact sums
};

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) {
        return;
    }
    uvec4 record = records[first + i];
    ivec3 position = weight * bitfieldExtract(ivec3(record.yzw), 0, 18);
    ivec3 normal = weight * bitfieldExtract(ivec3(record.yzw), 18, 14);
    uint at = 6u * record.x;
    atomicAdd(sums[at], position.x);
    atomicAdd(sums[at + 1u], position.y);
    atomicAdd(sums[at + 2u], position.z);
    atomicAdd(sums[at + 3u], normal.x);
    atomicAdd(sums[at + 4u], normal.y);
    atomicAdd(sums[at + 5u], normal.z);
}
