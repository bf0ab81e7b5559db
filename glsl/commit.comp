// With an error budget: the weights that go become those that poses hold. An invocation takes 32 targets of a head.
// CPU twin: animation::budget::Waiting::commit.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "animation.glsl"

void main() {
    uint i = flat_invocation();
    if (i >= heads * words) return;
    uint phase = state[phases_at + i];
    if (phase == NEW || phase == LEFT_OUT) return;
    uint head = i / words;
    uint asked = 0u;
    for (uint w = 0u; w < words; ++w) asked |= state[bits(ASKED) + head * words + w];
    // A head is new or shown again, or its face is still: nothing waits.
    uint goes = phase != GOES_ON || asked == 0u ? 0xffffffffu : state[bits(GOES) + i];
    state[bits(GOES) + i] = 0u;

    uint first = (i % words) * 32u;
    uint count = min(targets - first, 32u);
    uint changed = 0u, active_bits = 0u;
    for (uint t = 0u; t < count; ++t) {
        uint at = head * targets + first + t;
        int weight = int((goes >> t & 1u) != 0u ? state[requested_at + at] : state[weights_at + at]);
        commit(at, weight, 1u << t, changed, active_bits);
    }
    state[bits(CHANGED) + i] = changed;
    state[bits(ACTIVE) + i] = active_bits;
}
