// The end of scatter: pose = base + sum · unit. CPU twin: cpu::blocks, exact sums.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "abi.glsl"

layout(local_size_x = WORKGROUP) in;

layout(set = 0, binding = 1, std430) readonly buffer Sums { int sums[]; };
layout(set = 0, binding = 2, std430) readonly buffer BasePose { vec2 base_pose[]; };
layout(set = 0, binding = 3, std430) writeonly buffer DestinationPose { vec2 destination_pose[]; };

layout(push_constant) uniform Push {
    uint first_vertex;
    float position_unit;   // powers of two: the products are exact
    float normal_unit;
};

void main() {
    // Vertices are padded to whole workgroups: no invocation is idle.
    uint vertex = first_vertex + gl_GlobalInvocationID.x;
    precise vec2 unit[3] = {vec2(position_unit), vec2(position_unit, normal_unit), vec2(normal_unit)};
    for (uint i = 0u; i < 3u; ++i) {
        uint at = 3u * vertex + i;
        precise vec2 sum = vec2(float(sums[2u * at]), float(sums[2u * at + 1u])) * unit[i];
        precise vec2 pose = base_pose[at] + sum;
        destination_pose[at] = pose;
    }
}
