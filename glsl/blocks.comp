// One workgroup updates one block of one instance: pose = source + Σ coefficient · delta, over the entries in the work
// list, for the components in their masks. No atomics: no other workgroup writes the block. For software drivers; GPUs
// update whole blocks in crowd.comp. CPU twin: cpu::blocks.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "abi.glsl"
#define PLACES_ID 2
#include "places.glsl"
#include "blocks.glsl"

const uint MASK_WORDS = BLOCK_SIZE / 32u;
const uint MASKED_WORDS = ITEM_WORDS + 6u * MASK_WORDS;

// Beginning of a lane's vertex, as indices of numbers.
struct Place {
    uint source;
    uint destination;
    uint base;
    bool rebuilt;
};

// Stores number `c`, which is number `k` of the pose's vertex.
void store(Place place, uint c, uint k, float added) {
    float before = place.rebuilt ? uintBitsToFloat(asset[place.base + c]) : poses[place.source + k];
    poses[place.destination + k] = before + added;
}

// Component `c` of the lane's vertex, if the mask says that it changes.
#define COMPONENT(c, k, sum) \
    if (STORES(c) && (work[masks + c * MASK_WORDS] >> bit & 1u) != 0u) store(place, c, k, sum);

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

    uint vertex = block * BLOCK_SIZE + lane;
    uint at = vertex * VERTEX_NUMBERS;
    bool rebuilt = (work[item] & REBUILT) != 0u;
    uint bit = lane & 31u;
    uint masks = item + ITEM_WORDS + (lane >> 5);
    Place place;
    place.source = (slots_word & 0xffffu) * pose_floats + at;
    place.destination = (slots_word >> 16) * pose_floats + at;
    place.base = base_at + vertex * 6u;
    place.rebuilt = rebuilt;
    COMPONENT(0u, PLACE_0, position.x)
    COMPONENT(1u, PLACE_1, position.y)
    COMPONENT(2u, PLACE_2, position.z)
    COMPONENT(3u, PLACE_3, normal.x)
    COMPONENT(4u, PLACE_4, normal.y)
    COMPONENT(5u, PLACE_5, normal.z)
}
