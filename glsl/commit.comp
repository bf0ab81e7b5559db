// With an error budget: weights whose change is applied become those that poses hold. An invocation processes 32
// targets of an instance. CPU twin: update::animated::reference::Deferred::commit.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "animation.glsl"

void main() {
    uint i = flat_invocation();
    if (i >= heads * words) return;
    uint phase = state[phases_at + i];
    if (phase == NEW) return;
    uint head = i / words;
    uint requested = 0u;
    for (uint w = 0u; w < words; ++w) requested |= state[bits(REQUESTED) + head * words + w];
    // Nothing is deferred if an instance is new or shown again, or no change is requested.
    uint applied = phase != CONTINUED || requested == 0u ? 0xffffffffu : state[bits(APPLIED) + i];
    state[bits(APPLIED) + i] = 0u;

    uint first = (i % words) * 32u;
    uint count = min(targets - first, 32u);
    uint changed = 0u, active_bits = 0u;
    for (uint t = 0u; t < count; ++t) {
        uint at = head * targets + first + t;
        int weight = int((applied >> t & 1u) != 0u ? state[requested_at + at] : state[weights_at + at]);
        commit(at, weight, 1u << t, changed, active_bits);
    }
    state[bits(CHANGED) + i] = changed;
    state[bits(ACTIVE) + i] = active_bits;
}
