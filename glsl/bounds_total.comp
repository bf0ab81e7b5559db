// The bounds of a pose from those of all its parts, written into a host buffer by one workgroup.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "abi.glsl"

layout(local_size_x = WORKGROUP) in;

layout(set = 0, binding = 0, std430) readonly buffer Parts { float parts[]; };
layout(set = 0, binding = 1, std430) writeonly buffer Bounds { float bounds[]; };

layout(push_constant) uniform Push {
    uint count;      // parts
    uint bounds_at;  // index of the first of six numbers: least and greatest coordinates
};
#include "extent.glsl"

void main() {
    uint lane = gl_LocalInvocationID.x;
    uint at = 6u * min(lane, count - 1u);
    vec3 low = vec3(parts[at], parts[at + 1u], parts[at + 2u]);
    vec3 high = vec3(parts[at + 3u], parts[at + 4u], parts[at + 5u]);
    for (uint part = lane + WORKGROUP; part < count; part += WORKGROUP) {
        at = 6u * part;
        low = min(low, vec3(parts[at], parts[at + 1u], parts[at + 2u]));
        high = max(high, vec3(parts[at + 3u], parts[at + 4u], parts[at + 5u]));
    }
    reduce(low, high);
    if (lane == 0u) {
        bounds[bounds_at] = low.x;
        bounds[bounds_at + 1u] = low.y;
        bounds[bounds_at + 2u] = low.z;
        bounds[bounds_at + 3u] = high.x;
        bounds[bounds_at + 4u] = high.y;
        bounds[bounds_at + 5u] = high.z;
    }
}
