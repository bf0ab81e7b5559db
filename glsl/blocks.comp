// One workgroup updates one block of one instance: pose = source + Σ coefficient · delta, over the entries that the
// work list names, for the components that its masks name. No atomics: nobody else writes the block.
// For software drivers: GPUs take whole blocks, crowd.comp. CPU twin: cpu::blocks.
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
};

void store(Place place, uint k, float added) {
    float before = place.rebuilt ? uintBitsToFloat(asset[place.base + k]) : poses[place.source + k];
    poses[place.destination + k] = before + added;
}

// Component `c` of the lane's vertex, where the mask says that it changes.
#define COMPONENT(c, sum) \
    if ((work[masks + c * MASK_WORDS] >> bit & 1u) != 0u) store(place, c, sum);

void main() {
    uint item = first_item + gl_WorkGroupID.x * MASKED_WORDS;
    uint block = work[item] & ~REBUILT;
    uint slots_word = work[item + 1u];
    uint element = elements_at + 2u * work[item + 2u];
    uint count = work[item + 3u];
    uint lane = gl_LocalInvocationID.x;

    vec3 position = vec3(0.0);
    vec3 normal = vec3(0.0);
    for (uint i = 0u; i < count; ++i) {
        DELTA dp[1], dn[1];
        uvec2 shifts;
        load_entry(work[element + 2u * i], lane, dp, dn, shifts);
        uint coefficient = work[element + 2u * i + 1u];
        position += FACTOR_OF(coefficient, position_unit, shifts.x) * vec3(dp[0]);
        normal += FACTOR_OF(coefficient, normal_unit, shifts.y) * vec3(dn[0]);
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
    COMPONENT(0u, position.x)
    COMPONENT(1u, position.y)
    COMPONENT(2u, position.z)
    COMPONENT(3u, normal.x)
    COMPONENT(4u, normal.y)
    COMPONENT(5u, normal.z)
}
