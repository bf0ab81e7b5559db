// An item of the work list is a block of up to INSTANCES instances, with all of its vertices: pose = source + Σ coefficient
// · delta. The deltas of an entry are loaded and decoded once for all instances; rows of the work list have a
// coefficient for each. A workgroup processes an item, or two if subgroups would have more lanes than a block has
// vertices. Software drivers that read texels run crowd_texels.comp instead. CPU twin: cpu::blocks.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "abi.glsl"

#include "crowd_constants.glsl"
// Entries are decoded in few registers, at the price of some instructions.
layout(constant_id = 4) const bool FEW_REGISTERS = false;
#define HAS_FEW_REGISTERS

#include "blocks.glsl"
#include "tiles.glsl"

// What is added to the lane's vertex of one instance; later, what is stored.
struct Sums {
    ADDEND position;
    ADDEND normal;
};

// Repeats a statement for each instance. The first four are written out: compilers for VideoCore and Mali keep arrays
// that a loop indexes in memory, even if they unroll it.
#define EACH_INSTANCE(DO) \
    DO(0u) \
    if (INSTANCES != 1u) { DO(1u) } \
    if (INSTANCES / 4u != 0u) { DO(2u) DO(3u) } \
    if (INSTANCES == TILE) { [[unroll]] for (uint h = 4u; h < TILE; ++h) { DO(h) } }

Sums plus_entry(Sums sums, uint coefficient, ivec3 position, ivec3 normal, uvec2 shifts) {
    sums.position += TIMES(FACTOR_OF(coefficient, position_unit, shifts.x), position);
    sums.normal += TIMES(FACTOR_OF(coefficient, normal_unit, shifts.y), normal);
    return sums;
}

#ifdef ROUNDED_PRODUCTS
// Subtracts what the pose holds of an entry.
Sums minus_entry(Sums sums, uint coefficient, ivec3 position, ivec3 normal, uvec2 shifts) {
    int weight = int(coefficient) >> 16; // the one that it holds, as in FACTOR_OF
    sums.position -= ROUNDED((weight << shifts.x) * position);
    sums.normal -= ROUNDED((weight << shifts.y) * normal);
    return sums;
}

// The sum of an instance that starts from the base pose; that of a copy is 0, and stays 0.
Sums rounded_sum(Sums sums) {
    return Sums(ROUNDED(sums.position), ROUNDED(sums.normal));
}
#endif

// Whether all instances start from the base pose: then no weight is replaced, and no pose loaded.
bool all_from_base(uint item) {
    const uint every = (1u << INSTANCES) - 1u;
    return ALL_REBUILT || (work[item + 3u] & every) == every;
}

// Adds the pose that the instance starts from.
Sums plus_source(Sums sums, uint slots, uint at, uint rebuilt) {
    ADDEND position, normal;
    LOAD_VERTEX(poses, (slots & 0xffffu) * pose_floats + at, position, normal)
#ifdef INTEGER_POSES
    // Tiles that the GPU plans have instances of both kinds.
    int keep = int(rebuilt & 1u) - 1;
    position &= keep;
    normal &= keep;
#endif
    return Sums(sums.position + position, sums.normal + normal);
}

// The base pose, the same for all instances.
void load_base(uint vertex, out ADDEND position, out ADDEND normal) {
    uint at = base_at + 6u * vertex;
#ifdef ROUNDED_PRODUCTS
    if (ROUNDED_SUMS)
#endif
    {
        position = ADDEND(NUMBER_OF(base[at]), NUMBER_OF(base[at + 1u]), NUMBER_OF(base[at + 2u]));
        normal = ADDEND(NUMBER_OF(base[at + 3u]), NUMBER_OF(base[at + 4u]), NUMBER_OF(base[at + 5u]));
    }
#ifdef ROUNDED_PRODUCTS
    else {
        LOAD_WORDS_OF(base, base_at + 3u * vertex, position, normal)
    }
#endif
}

void store(uint slots, uint at, Sums sums) {
    STORE_VERTEX(poses, (slots >> 16) * pose_floats + at, sums.position, sums.normal)
}

void main() {
    uint lane = gl_LocalInvocationID.x, number = gl_WorkGroupID.x;
    uvec3 lanes = gl_WorkGroupSize;
    bool is_shared = lanes.x != BLOCK_SIZE;
    if (is_shared) {
        number = number * (lanes.x / BLOCK_SIZE) + lane / BLOCK_SIZE;
        lane %= BLOCK_SIZE;
    }
    uint item = first_item + number * TILE_WORDS;
    uint rows = work[item + 2u];
    // The items that fill up the last workgroup of a list have no rows; all others have some.
    if (is_shared && rows == 0u) return;
    uint next = work[item + 1u], end = next + rows * ROW_WORDS(INSTANCES);
    uint vertex = work[item] * BLOCK_SIZE + lane;
    uint at = 6u * vertex;

    Sums sums[TILE];
#define START(h) sums[h] = Sums(ADDEND(0), ADDEND(0));
    EACH_INSTANCE(START)

#ifdef ROUNDED_PRODUCTS
    bool replaces = !(ROUNDED_SUMS || all_from_base(item));
#endif
    // Deltas are shifted where that is less work than to shift all coefficients.
#ifdef INTEGER_POSES
#define SHIFT_ONCE if (INSTANCES / 4u != 0u) { \
            position[0] <<= shifts.x; \
            normal[0] <<= shifts.y; \
            shifts = uvec2(0u); \
        }
#else
#define SHIFT_ONCE
#endif
    // There is at least one row: a loop that tests first would run its body once more on software drivers, for no lane.
#define ADD(h) sums[h] = plus_entry(sums[h], work[next + 1u + h], position[0], normal[0], shifts);
#define SUBTRACT(h) sums[h] = minus_entry(sums[h], work[next + 1u + h], position[0], normal[0], shifts);
#define EACH_ROW(DO_ENTRY) do { \
        ivec3 position[1], normal[1]; \
        uvec2 shifts; \
        load_entry(work[next], lane, position, normal, shifts); \
        RAISE(shifts) \
        SHIFT_ONCE \
        DO_ENTRY \
        next += ROW_WORDS(INSTANCES); \
    } while (next < end);
#ifdef ROUNDED_PRODUCTS
    // The widest tiles have a loop of their own: the branch would stand between the loads of a row and of the next. Where
    // tiles are narrower, it would take more registers than there are.
    if (INSTANCES == TILE && !replaces) {
        EACH_ROW(EACH_INSTANCE(ADD))
    } else {
        EACH_ROW(EACH_INSTANCE(ADD) if (replaces) { EACH_INSTANCE(SUBTRACT) })
    }
#else
    EACH_ROW(EACH_INSTANCE(ADD))
#endif

    // Poses are loaded after the loop, so that they do not take registers in it.
    // Only tiles that the GPU plans, for integers, have instances of both kinds.
    uint rebuilt = work[item + 3u];
#ifdef INTEGER_POSES
    if (ALL_REBUILT || rebuilt != 0u) {
#else
    if (ALL_REBUILT) {
#endif
        ADDEND position, normal;
        load_base(vertex, position, normal);
#define BASE(h) \
        if (ALL_REBUILT || (rebuilt >> (h) & 1u) != 0u) { \
            sums[h] = Sums(sums[h].position + position, sums[h].normal + normal); \
        }
        EACH_INSTANCE(BASE)
    }

#ifdef ROUNDED_PRODUCTS
    if (ROUNDED_SUMS) {
#define ROUND(h) sums[h] = rounded_sum(sums[h]);
        EACH_INSTANCE(ROUND)
    }
#endif

    // All sources are loaded before the first is stored, since a tile may have an instance several times: plans of the
    // GPU fill tiles up.
    uint slots[TILE];
#define SLOTS(h) slots[h] = work[item + 4u + h];
    EACH_INSTANCE(SLOTS)
    if (!all_from_base(item)) {
#define SOURCE(h) sums[h] = plus_source(sums[h], slots[h], at, rebuilt >> h);
        EACH_INSTANCE(SOURCE)
    }
#define STORE(h) store(slots[h], at, sums[h]);
    EACH_INSTANCE(STORE)
}
