// Reads a whole buffer and writes almost nothing: the device's read bandwidth.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "abi.glsl"

layout(local_size_x = WORKGROUP) in;

layout(set = 0, binding = 0, std430) readonly buffer Input { uvec4 values[]; };
layout(set = 0, binding = 1, std430) writeonly buffer Output { uint result; };

layout(push_constant) uniform Push {
    uint count;    // of values
    uint stride;   // invocations
};

void main() {
    uvec4 sum = uvec4(0u);
    for (uint i = gl_GlobalInvocationID.x; i < count; i += stride) sum ^= values[i];
    // Never true of the data measured on, but the compiler can't know.
    if ((sum.x ^ sum.y ^ sum.z ^ sum.w) == 0xdeadbeefu) result = sum.x;
}
