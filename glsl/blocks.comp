// One workgroup updates one block of one instance: pose = source + Σ coefficient · delta, over the entries that the
// work list names, for the components that its masks name. No atomics: nobody else writes the block.
// CPU twin: cpu::blocks::Block::run. Work list: src/plan/blocks/list.rs. Entries: src/mesh/packed/blocks/mod.rs.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "entry.glsl"

// Vertices of a lane: several share the loads of an entry, which software drivers pay for lane by lane.
#ifndef VERTICES
#define VERTICES 1
#endif

layout(local_size_x_id = 0) in;   // BLOCK_SIZE / VERTICES
layout(constant_id = 1) const uint BLOCK_SIZE = 64;

layout(set = 0, binding = 0, std430) readonly buffer Asset { uint asset[]; };
layout(set = 0, binding = 1, std430) readonly buffer Work { uint work[]; };
// Slots of the instances, source and destination alike. An invocation loads and stores its own vertices only.
layout(set = 0, binding = 2, std430) buffer Poses { float poses[]; };
#ifdef EXACT
layout(set = 0, binding = 3, std430) buffer Sums { int sums[]; };
#define ADDEND ivec3
#else
#define ADDEND vec3
#endif

layout(push_constant) uniform Push {
    uint first_item;    // index of the first item's first word
    uint elements_at;   // index of the first element's first word
    uint deltas_at;     // index of the first delta word of the asset
    uint base_at;       // index of the base pose's first word
    uint pose_floats;   // floats of a pose
    uint slots;         // poses of an instance
    float position_unit; // exact: input units of a sum; float: of a step
    float normal_unit;
};

const uint MASK_WORDS = BLOCK_SIZE / 32u;
const uint ITEM_WORDS = 4u + 6u * MASK_WORDS;
const uint REBUILT = 0x80000000u;

#ifdef EXACT
#define COEFFICIENT(bits, unit, shift) (int(bits) << (shift))
#else
// Unit and shift are powers of two: these products are exact.
#define COEFFICIENT(bits, unit, shift) (uintBitsToFloat(bits) * ((unit) * float(1u << (shift))))
#endif

void add_entry(uint entry, uint coefficient, uint lane, inout ADDEND position[VERTICES], inout ADDEND normal[VERTICES]) {
#if defined(FAST)
    uint header = asset[entry];
    ADDEND p = ADDEND(COEFFICIENT(coefficient, position_unit, header & 0xffu));
    ADDEND n = ADDEND(COEFFICIENT(coefficient, normal_unit, (header >> 8) & 0xffu));
    uint at = deltas_at + entry * (BLOCK_SIZE / 4u * 9u);
    uint first = lane * VERTICES;
#if VERTICES == 4
    uint bytes = asset[at + 2u * BLOCK_SIZE + lane];
#endif
    for (int i = 0; i < VERTICES; ++i) {
        uint vertex = first + uint(i);
#if VERTICES == 4
        int c = bitfieldExtract(int(bytes), 8 * i, 8);
#else
        int c = bitfieldExtract(int(asset[at + 2u * BLOCK_SIZE + (vertex >> 2)]), int(8u * (vertex & 3u)), 8);
#endif
        ivec3 dp, dn;
        decode_fast(asset[at + vertex], asset[at + BLOCK_SIZE + vertex], c, dp, dn);
        position[i] += p * ADDEND(dp);
        normal[i] += n * ADDEND(dn);
    }
#elif defined(SMALL)
    uint header = entry * (2u + MASK_WORDS);
    uint word = lane >> 5;
    uint mask = asset[header + 2u + word];
    uint bit = lane & 31u;
    if ((mask >> bit & 1u) == 0u) return;
    // The place of the record among those of the vertices in the mask.
    uint rank = uint(bitCount(mask & ((1u << bit) - 1u)));
    for (uint i = 0u; i < word; ++i) rank += uint(bitCount(asset[header + 2u + i]));
    uint widths = asset[header + 1u];
    uvec3 wp = uvec3(widths, widths >> 5, widths >> 10) & 31u;
    uvec3 wn = uvec3(widths >> 15, widths >> 20, widths >> 25) & 31u;
    uvec3 ap = uvec3(0u, wp.x, wp.x + wp.y);
    uint half_record = ap.z + wp.z;
    uvec3 an = half_record + uvec3(0u, wn.x, wn.x + wn.y);
    uint size = an.z + wn.z;
    uint from = rank * size;
    uint at = deltas_at + asset[header] + (from >> 5);
    uint shift = from & 31u;
    // Load no word that the record does not reach.
    uint w0 = asset[at];
    uint w1 = shift + size > 32u ? asset[at + 1u] : 0u;
    uint w2 = shift + size > 64u ? asset[at + 2u] : 0u;
    uint w3 = shift + size > 96u ? asset[at + 3u] : 0u;
    uvec3 record = (uvec3(w0, w1, w2) >> shift) | ((uvec3(w1, w2, w3) << 1) << (31u - shift));
    ivec3 dp = ivec3(record_field(record, ap.x, wp.x), record_field(record, ap.y, wp.y), record_field(record, ap.z, wp.z));
    ivec3 dn = ivec3(record_field(record, an.x, wn.x), record_field(record, an.y, wn.y), record_field(record, an.z, wn.z));
    position[0] += COEFFICIENT(coefficient, position_unit, 0) * ADDEND(dp);
    normal[0] += COEFFICIENT(coefficient, normal_unit, 0) * ADDEND(dn);
#else
    uint at = deltas_at + entry * (6u * BLOCK_SIZE) + lane;
    float c = uintBitsToFloat(coefficient);
    position[0] += c * vec3(uintBitsToFloat(asset[at]), uintBitsToFloat(asset[at + BLOCK_SIZE]),
                            uintBitsToFloat(asset[at + 2u * BLOCK_SIZE]));
    normal[0] += c * vec3(uintBitsToFloat(asset[at + 3u * BLOCK_SIZE]), uintBitsToFloat(asset[at + 4u * BLOCK_SIZE]),
                          uintBitsToFloat(asset[at + 5u * BLOCK_SIZE]));
#endif
}

// On software drivers, float sums take whole vertices, and rebuilt items a pipeline of their own: what such a driver
// loads and stores under control flow costs several times as much, whatever the masks leave out.
#if VERTICES == 4 && !defined(EXACT)
#define STRAIGHT
layout(constant_id = 2) const bool REBUILT_ITEMS = false;
#endif

#ifndef STRAIGHT
// Where a lane's vertices are, as indices of their first component.
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
        poses[place.destination + k] = poses[place.source + k];
        return;
    }
    int sum = (place.rebuilt ? 0 : sums[place.sums + k]) + added;
    sums[place.sums + k] = sum;
    // The product is exact, the unit being a power of two; sums above 24 bits are rounded before.
    precise float value = uintBitsToFloat(asset[place.base + k]) + float(sum) * unit;
    poses[place.destination + k] = value;
}
#else
void store(Place place, uint k, float added, float unit) {
    float before = place.rebuilt ? uintBitsToFloat(asset[place.base + k]) : poses[place.source + k];
    poses[place.destination + k] = before + added;
}
#endif

// Component `c` of the lane's vertices, where the mask says that it changes.
#define STORE(i, c, sum, field) \
    if ((mask >> i & 1u) != 0u) store(place, 6u * i + c, sum[i].field, c < 3u ? position_unit : normal_unit);
#if VERTICES == 4
#define STORES(c, sum, field) STORE(0u, c, sum, field) STORE(1u, c, sum, field) STORE(2u, c, sum, field) STORE(3u, c, sum, field)
#else
#define STORES(c, sum, field) STORE(0u, c, sum, field)
#endif
#define COMPONENT(c, sum, field) { uint mask = work[masks + c * MASK_WORDS] >> shift; STORES(c, sum, field) }
#endif

void main() {
    uint item = first_item + gl_WorkGroupID.x * ITEM_WORDS;
    uint block = work[item] & ~REBUILT;
    uint slots_word = work[item + 1u];
    uint source = (slots_word & 0xffffu) * pose_floats;
    uint destination = (slots_word >> 16) * pose_floats;
    uint element = elements_at + 2u * work[item + 2u];
    uint count = work[item + 3u];
    uint lane = gl_LocalInvocationID.x;

    ADDEND position[VERTICES];
    ADDEND normal[VERTICES];
    for (int i = 0; i < VERTICES; ++i) {
        position[i] = ADDEND(0);
        normal[i] = ADDEND(0);
    }
    uint vertex = lane * VERTICES;
    uint at = (block * BLOCK_SIZE + vertex) * 6u;
#ifdef STRAIGHT
    float before[24];
    for (int i = 0; i < 24; ++i) {
        before[i] = REBUILT_ITEMS ? uintBitsToFloat(asset[base_at + at + uint(i)]) : poses[source + at + uint(i)];
    }
#endif

    for (uint i = 0u; i < count; ++i) add_entry(work[element + 2u * i], work[element + 2u * i + 1u], lane, position, normal);

#ifdef STRAIGHT
    for (int i = 0; i < VERTICES; ++i) {
        uint k = destination + at + 6u * uint(i);
        poses[k] = before[6 * i] + position[i].x;
        poses[k + 1u] = before[6 * i + 1] + position[i].y;
        poses[k + 2u] = before[6 * i + 2] + position[i].z;
        poses[k + 3u] = before[6 * i + 3] + normal[i].x;
        poses[k + 4u] = before[6 * i + 4] + normal[i].y;
        poses[k + 5u] = before[6 * i + 5] + normal[i].z;
    }
#else
    bool rebuilt = (work[item] & REBUILT) != 0u;
    uint shift = vertex & 31u;
    uint masks = item + 4u + (vertex >> 5);
    Place place;
    place.source = source + at;
    place.destination = destination + at;
    place.base = base_at + at;
    place.rebuilt = rebuilt;
#ifdef EXACT
    place.sums = (slots_word >> 16) / slots * pose_floats + at;
    place.copied = count == 0u && !rebuilt;
#endif
    // Unrolled by hand: arrays that are indexed by a variable would live in memory.
    COMPONENT(0u, position, x)
    COMPONENT(1u, position, y)
    COMPONENT(2u, position, z)
    COMPONENT(3u, normal, x)
    COMPONENT(4u, normal, y)
    COMPONENT(5u, normal, z)
#endif
}
