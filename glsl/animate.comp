// Samples the clips that each instance plays, and compares the result with the weights that its poses hold. A team of
// LANES invocations processes 32 targets of an instance: one word of the bits that mark changed weights. CPU twin:
// update::animated::reference::sample.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "animation.glsl"

// 32: an invocation samples a target. 1: it samples all 32 of a word, for software drivers, on which barriers are slow.
layout(constant_id = 0) const uint LANES = 1;

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

// The bits of the targets that an invocation has sampled.
struct Bits {
    uint changed;
    uint nonzero;
};

// Samples target `lane` of word `i`, or all of its targets.
Bits sampled(uint i, uint lane) {
    uint instance = i / words;
    uint record = instance * RECORD_WORDS;
    uint flags = state[record + 3u];
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

    Bits found = Bits(0u, 0u);
    uint first = (i % words) * 32u;
    uint count = min(targets - first, 32u);
    uint rounds = LANES == 1u ? count : 1u;
    for (uint n = 0u; n < rounds; ++n) {
        uint t = lane + n;
        if (LANES != 1u && t >= count) break;
        uint target = first + t;
        uint at = instance * targets + target;
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
        if (delta != 0) found.changed |= bit;
        if (weight != 0) found.nonzero |= bit;
    }
    return found;
}

shared Bits teams[WORKGROUP / 32u];

// Returns the bits of all invocations of a team, which pass here together.
Bits joined(Bits own, uint lane) {
    if (LANES == 1u) return own;
    uint team = gl_LocalInvocationID.x / LANES;
    if (lane == 0u) teams[team] = Bits(0u, 0u);
    barrier();
    atomicOr(teams[team].changed, own.changed);
    atomicOr(teams[team].nonzero, own.nonzero);
    barrier();
    return teams[team];
}

void main() {
    uint invocation = flat_invocation();
    uint i = invocation / LANES, lane = invocation % LANES;
    bool exists = i < instances * words;
    bool shown = exists && (state[i / words * RECORD_WORDS + 3u] & HIDDEN) == 0u;
    Bits found = Bits(0u, 0u);
    if (shown) found = sampled(i, lane);
    found = joined(found, lane);
    if (!exists || lane != 0u) return;
    uint phase = state[phases_at + i];
    state[phases_at + i] = !shown ? NEW : phase == NEW ? FIRST : CONTINUED;
    if (!shown) return;
    state[bits(CHANGED) + i] = found.changed;
    state[bits(ACTIVE) + i] = found.nonzero;
}
