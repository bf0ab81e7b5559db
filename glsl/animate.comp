// Samples the clips that each instance plays, and compares the result with the weights that its poses hold. An
// invocation processes 32 targets of an instance: one word of the bits that mark changed weights. CPU twin:
// update::animated::reference::sample.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "animation.glsl"

int key(uint clip, uint index) {
    uint first = tables[4u * clip];
    if (tables[4u * clip + 3u] == 32u) return int(tables[first + index]);
    int half_word = bitfieldExtract(int(tables[first + (index >> 1)]), int(16u * (index & 1u)), 16);
    return half_word << tables[4u * clip + 2u];
}

// Interpolates from k0 to k1 by f·2⁻¹⁶, rounded to nearest: the product needs 64 bits.
int interpolate(int k0, int k1, uint f) {
    int high;
    int low;
    imulExtended(k1 - k0, int(f), high, low);
    uint carry;
    uint sum = uaddCarry(uint(low), 0x8000u, carry);
    return k0 + int((uint(high) + carry) << 16 | sum >> 16);
}

const uint WHOLE = 0x10000u;

// Returns the share of the target of a rank that is kept.
uint kept(uint level, uint rank) {
    uint whole = level >> 16;
    return rank < whole ? WHOLE : rank == whole ? level & 0xffffu : 0u;
}

void main() {
    uint i = flat_invocation();
    if (i >= heads * words) return;
    uint head = i / words;
    uint record = head * RECORD_WORDS;
    uint flags = state[record + 3u];
    uint phase = state[phases_at + i];
    if ((flags & HIDDEN) != 0u) {
        state[phases_at + i] = NEW;
        return;
    }
    state[phases_at + i] = phase == NEW ? FIRST : CONTINUED;

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

    // With a level of detail: the number of targets kept, in steps of 2⁻¹⁶, and the position of the ranks in Tables.
    uint level = state[record + 6u];
    uint ranks_at = state[record + 7u];

    uint first = (i % words) * 32u;
    uint count = min(targets - first, 32u);
    uint changed = 0u;
    uint active_bits = 0u;
    for (uint t = 0u; t < count; ++t) {
        uint target = first + t;
        uint at = head * targets + target;
        uint bit = 1u << t;
        int weight = 0;
        uint factor = ranks_at == 0u ? WHOLE : kept(level, tables[ranks_at + target]);
        if (playing && factor != 0u) {
            weight = interpolate(key(clip, frame * targets + target), key(clip, next * targets + target), f);
            if (factor != WHOLE) weight = interpolate(0, weight, factor);
        }
        int delta = weight - int(state[weights_at + at]);
        state[weights_at + at] = uint(weight);
        state[deltas_at + at] = uint(delta);
        if (delta != 0) changed |= bit;
        if (weight != 0) active_bits |= bit;
    }
    state[bits(CHANGED) + i] = changed;
    state[bits(ACTIVE) + i] = active_bits;
}
