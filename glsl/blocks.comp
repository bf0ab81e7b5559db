// One workgroup updates one block of one instance: pose = source + Σ coefficient · delta, over the entries that the
// work list names, for the components that its masks name. No atomics: nobody else writes the block.
// CPU twin: cpu::blocks::Block::run.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "abi.glsl"
#include "blocks.glsl"

const uint MASK_WORDS = BLOCK_SIZE / 32u;
const uint MASKED_WORDS = ITEM_WORDS + 6u * MASK_WORDS;

// Where a lane's vertex is, as indices of its first component.
struct Place {
    uint source;
    uint destination;
    uint base;
    bool rebuilt;
#ifdef EXACT
    uint sums;
    bool copied;
#endif
};

#ifdef EXACT
void store(Place place, uint k, int added, float unit) {
    if (place.copied) {
        STORE_COMPONENT(place.destination + k, LOAD_COMPONENT(place.source + k));
        return;
    }
    int sum = (place.rebuilt ? 0 : sums[place.sums + k]) + added;
    sums[place.sums + k] = sum;
    // The product is exact, the unit being a power of two; sums above 24 bits are rounded before.
    precise float value = uintBitsToFloat(asset[place.base + k]) + float(sum) * unit;
    STORE_COMPONENT(place.destination + k, value);
}
#else
void store(Place place, uint k, float added, float unit) {
    float before = place.rebuilt ? uintBitsToFloat(asset[place.base + k]) : LOAD_COMPONENT(place.source + k);
    STORE_COMPONENT(place.destination + k, before + added);
}
#endif

// Component `c` of the lane's vertex, where the mask says that it changes.
#define COMPONENT(c, sum) \
    if ((work[masks + c * MASK_WORDS] >> bit & 1u) != 0u) store(place, c, sum, c < 3u ? position_unit : normal_unit);

void main() {
    uint item = first_item + gl_WorkGroupID.x * MASKED_WORDS;
    uint block = work[item] & ~REBUILT;
    uint slots_word = work[item + 1u];
    uint element = elements_at + 2u * work[item + 2u];
    uint count = work[item + 3u];
    uint lane = gl_LocalInvocationID.x;

    ADDEND position = ADDEND(0);
    ADDEND normal = ADDEND(0);
    for (uint i = 0u; i < count; ++i) {
        DELTA dp[1], dn[1];
        uvec2 shifts;
        load_entry(work[element + 2u * i], lane, dp, dn, shifts);
        uint coefficient = work[element + 2u * i + 1u];
        position += COEFFICIENT(coefficient, position_unit, shifts.x) * ADDEND(dp[0]);
        normal += COEFFICIENT(coefficient, normal_unit, shifts.y) * ADDEND(dn[0]);
    }

    uint at = (block * BLOCK_SIZE + lane) * 6u;
    bool rebuilt = (work[item] & REBUILT) != 0u;
    uint bit = lane & 31u;
    uint masks = item + ITEM_WORDS + (lane >> 5);
    Place place;
    place.source = (slots_word & 0xffffu) * pose_floats + at;
    place.destination = (slots_word >> 16) * pose_floats + at;
    place.base = base_at + at;
    place.rebuilt = rebuilt;
#ifdef EXACT
    place.sums = (slots_word >> 16) / slots * pose_floats + at;
    place.copied = count == 0u && !rebuilt;
#endif
    COMPONENT(0u, position.x)
    COMPONENT(1u, position.y)
    COMPONENT(2u, position.z)
    COMPONENT(3u, normal.x)
    COMPONENT(4u, normal.y)
    COMPONENT(5u, normal.z)
}
