// How many items there are to how many workgroups are dispatched; the counters begin at 0 again.
// For lists that the CPU writes, src/update/blocks/dispatch.rs does this.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "animation.glsl"

void main() {
    for (uint i = gl_LocalInvocationID.x; i < counters; i += gl_WorkGroupSize.x) {
        uint count = control[i];
        control[i] = 0u;
        for (uint chunk = 0u; chunk < chunks; ++chunk) {
            uint at = counters + 3u * (i * chunks + chunk);
            control[at] = min(count, chunk_items);
            control[at + 1u] = 1u;
            control[at + 2u] = 1u;
            count -= min(count, chunk_items);
        }
    }
}
