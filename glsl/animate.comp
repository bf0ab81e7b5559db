// Samples what each head plays and compares with the weights that its poses hold. An invocation takes 32 targets of a
// head: a word of the bits that say which weights changed. CPU twin: animation::sample.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "animation.glsl"

layout(local_size_x = 64) in;

int key(uint clip, uint index) {
    uint first = tables[4u * clip];
    if (tables[4u * clip + 3u] == 32u) return int(tables[first + index]);
    int half_word = bitfieldExtract(int(tables[first + (index >> 1)]), int(16u * (index & 1u)), 16);
    return half_word << tables[4u * clip + 2u];
}

// From k0 to k1, f·2⁻¹⁶ of the way, to nearest: the product takes 64 bits.
int interpolate(int k0, int k1, uint f) {
    int high;
    int low;
    imulExtended(k1 - k0, int(f), high, low);
    uint carry;
    uint sum = uaddCarry(uint(low), 0x8000u, carry);
    return k0 + int((uint(high) + carry) << 16 | sum >> 16);
}

void main() {
    // Two dimensions: there may be more invocations than one holds.
    uint i = gl_GlobalInvocationID.x + gl_GlobalInvocationID.y * gl_NumWorkGroups.x * gl_WorkGroupSize.x;
    if (i >= heads * words) return;
    uint head = i / words;
    uint record = head * RECORD_WORDS;
    uint flags = state[record + 3u];
    uint phase = state[phases_at + i];
    if ((flags & HIDDEN) != 0u) {
        state[phases_at + i] = phase == NEW ? NEW : LEFT_OUT;
        return;
    }
    state[phases_at + i] = phase == NEW ? FIRST : (phase == LEFT_OUT ? SHOWN : GOES_ON);

    uint clip = state[record];
    bool playing = (flags & PLAYING) != 0u;
    uint frame = 0u, next = 0u, f = 0u;
    if (playing) {
        uint elapsed = uint(max(int(now - state[record + 1u]), 0));
        uint whole, fraction, carry;
        umulExtended(elapsed, state[record + 2u], whole, fraction);
        fraction = uaddCarry(fraction, state[record + 5u], carry);
        whole += state[record + 4u] + carry;
        f = fraction >> 16;
        uint frames = tables[4u * clip + 1u];
        uint last = frames - 1u;
        if ((flags & LOOP) != 0u) {
            frame = whole % frames;
            next = frame == last ? 0u : frame + 1u;
        } else if (whole >= last) {
            frame = last;
            next = last;
            f = 0u;
        } else {
            frame = whole;
            next = whole + 1u;
        }
        if ((flags & REVERSED) != 0u) {
            frame = last - frame;
            next = last - next;
        }
    }

    uint first = (i % words) * 32u;
    uint count = min(targets - first, 32u);
    uint changed = 0u, active_bits = 0u;
    for (uint t = 0u; t < count; ++t) {
        uint target = first + t;
        uint at = head * targets + target;
        int weight = 0;
        if (playing) weight = interpolate(key(clip, frame * targets + target), key(clip, next * targets + target), f);
        int delta = weight - int(state[weights_at + at]);
        state[weights_at + at] = uint(weight);
        state[deltas_at + at] = uint(delta);
        if (delta != 0) changed |= 1u << t;
        if (weight != 0) active_bits |= 1u << t;
    }
    state[changed_at + i] = changed;
    state[active_at + i] = active_bits;
}
