// One workgroup updates one block of up to HEADS instances, all of its vertices: pose = source + Σ coefficient · delta.
// The deltas of an entry are loaded and decoded once for all of them; rows of the work list have a coefficient for each.
// CPU twin: cpu::blocks, an instance at a time.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "abi.glsl"
#include "blocks.glsl"
#include "tiles.glsl"

layout(constant_id = 2) const uint HEADS = 1;
// Rows at a time: 1, or ROWS, which the planner makes their number a multiple of.
layout(constant_id = 3) const uint AT_ONCE = 1;
// All instances of all items start from the base pose, which is loaded once, or nothing where poses are displacements.
layout(constant_id = 4) const bool REBUILT_ITEMS = false;

// Numbers of a lane's vertices.
const uint NUMBERS = 6u * VERTICES;

// Of one vertex there is no array: VideoCore's compiler makes more of it.
#ifdef TEXELS
#define OF_VERTICES(name) name[VERTICES]
#define AT_VERTEX(name) name[v]
#define EACH_VERTEX [[unroll]] for (uint v = 0u; v < VERTICES; ++v)
#else
#define OF_VERTICES(name) name
#define AT_VERTEX(name) name
#define EACH_VERTEX
#endif

// What is added to the vertices of a lane, of one instance; then, what is stored.
struct Head {
    ADDEND OF_VERTICES(position);
    ADDEND OF_VERTICES(normal);
};

// For each head in turn. The first four are written out: compilers for VideoCore and Mali keep in memory what a loop
// indexes, even where they unroll it.
#ifdef TEXELS
#define EACH_HEAD(DO) [[unroll]] for (uint h = 0u; h < HEADS; ++h) { DO(h) }
#else
#define EACH_HEAD(DO) \
    DO(0u) \
    if (HEADS != 1u) { DO(1u) } \
    if (HEADS / 4u != 0u) { DO(2u) DO(3u) } \
    if (HEADS == TILE) { [[unroll]] for (uint h = 4u; h < TILE; ++h) { DO(h) } }
#endif

// Words that lie one after the other. LOAD_POSE and STORE_POSE_NUMBERS are the pose format's (pose.glsl).
#ifdef TEXELS
#define LOAD_WORDS(value, count, buffer, at) \
    [[unroll]] for (uint i = 0u; i < (count); i += 4u) { \
        uvec4 four = texelFetch(buffer, int(((at) + i) / 4u)); \
        [[unroll]] for (uint j = 0u; j < 4u; ++j) value[i + j] = four[j]; \
    }
#define FROM_NUMBERS(head, value) \
    EACH_VERTEX { \
        head.AT_VERTEX(position) = ADDEND(value[6u * v], value[6u * v + 1u], value[6u * v + 2u]); \
        head.AT_VERTEX(normal) = ADDEND(value[6u * v + 3u], value[6u * v + 4u], value[6u * v + 5u]); \
    }
#define TO_NUMBERS(value, head) \
    EACH_VERTEX { \
        [[unroll]] for (uint c = 0u; c < 3u; ++c) { \
            value[6u * v + c] = head.position[v][c]; \
            value[6u * v + 3u + c] = head.normal[v][c]; \
        } \
    }
// A tile, and a row: an entry, then its coefficients.
#define ITEM uint item[TILE_WORDS]; LOAD_WORDS(item, 4u + HEADS, work, first_item + gl_WorkGroupID.x * TILE_WORDS)
#define ITEM_WORD(i) item[i]
#define ROW uint row[ROW_WORDS(TILE)];
#define ROW_WORD(i) row[i]
void load_row(uint at, out uint row[ROW_WORDS(TILE)]) {
    if (HEADS == 1u) {
        uvec4 two = texelFetch(work, int(at / 4u));
        uvec2 one = (at & 2u) == 0u ? two.xy : two.zw;
        row[0] = one.x;
        row[1] = one.y;
        return;
    }
    LOAD_WORDS(row, ROW_WORDS(HEADS), work, at)
}
#else
#define ITEM uint item = first_item + gl_WorkGroupID.x * TILE_WORDS;
#define ITEM_WORD(i) work[item + (i)]
#define ROW uint row;
#define ROW_WORD(i) work[row + (i)]
void load_row(uint at, out uint row) {
    row = at;
}
#endif

// An entry.
struct Entry {
    DELTA dp[VERTICES];
    DELTA dn[VERTICES];
    uvec2 shifts;
};
Entry entry;
#ifdef TEXELS
Entry second;
#else
const uint v = 0u;
#endif

#define ADD_ENTRY(head, coefficient, entry) \
    FACTOR p = FACTOR_OF(coefficient, position_unit, entry.shifts.x); \
    FACTOR n = FACTOR_OF(coefficient, normal_unit, entry.shifts.y); \
    EACH_VERTEX { \
        head.AT_VERTEX(position) += TIMES(p, entry.dp[v], position_dropped); \
        head.AT_VERTEX(normal) += TIMES(n, entry.dn[v], normal_dropped); \
    }
Head with_entry(Head head, uint coefficient) {
    ADD_ENTRY(head, coefficient, entry)
    return head;
}
#ifdef TEXELS
Head with_second(Head head, uint coefficient) {
    ADD_ENTRY(head, coefficient, second)
    return head;
}
#endif

Head plus(Head head, Head source) {
    EACH_VERTEX {
        head.AT_VERTEX(position) += source.AT_VERTEX(position);
        head.AT_VERTEX(normal) += source.AT_VERTEX(normal);
    }
    return head;
}

Head loaded(uint slots, uint at, uint rebuilt) {
    Head head;
    LOAD_POSE(head, (slots & 0xffffu) * pose_floats + at)
#ifdef INTEGER_POSES
    // Tiles that plan.comp fills have instances of both kinds.
    int keep = int(rebuilt & 1u) - 1;
    EACH_VERTEX {
        head.AT_VERTEX(position) &= keep;
        head.AT_VERTEX(normal) &= keep;
    }
#endif
    return head;
}

void store(Head head, uint slots, uint at) {
    STORE_POSE_NUMBERS((slots >> 16) * pose_floats + at, head)
}

// The base pose, where poses are no displacements from it.
#ifdef TEXELS
#define BASE \
    uint words[NUMBERS]; \
    LOAD_WORDS(words, NUMBERS, asset, base_at + at) \
    NUMBER value[NUMBERS]; \
    [[unroll]] for (uint i = 0u; i < NUMBERS; ++i) value[i] = uintBitsToFloat(words[i]); \
    FROM_NUMBERS(base, value)
#else
#define BASE \
    uint from = base_at + at; \
    base.position = uintBitsToFloat(uvec3(asset[from], asset[from + 1u], asset[from + 2u])); \
    base.normal = uintBitsToFloat(uvec3(asset[from + 3u], asset[from + 4u], asset[from + 5u]));
#endif

void main() {
    ITEM
    uint next = ITEM_WORD(1u), end = next + ITEM_WORD(2u) * ROW_WORDS(HEADS);
    uint lane = gl_LocalInvocationID.x;
    uint at = (ITEM_WORD(0u) * BLOCK_SIZE + lane * VERTICES) * 6u;

    Head heads[TILE];
#define START(h) EACH_VERTEX { heads[h].AT_VERTEX(position) = ADDEND(0); heads[h].AT_VERTEX(normal) = ADDEND(0); }
    EACH_HEAD(START)

    // There is a row at least: a loop that asks first would run its body once more on software drivers, for no lane.
    // Two rows at a time, where there are several heads: what lives in memory is loaded and stored half as often.
    do {
        ROW
        load_row(next, row);
        load_entry(ROW_WORD(0u), lane, entry.dp, entry.dn, entry.shifts);
        next += ROW_WORDS(HEADS);
#define ADD(h) heads[h] = with_entry(heads[h], ROW_WORD(1u + h));
#ifdef TEXELS
        if (AT_ONCE != 1u) {
            uint row2[ROW_WORDS(TILE)];
            load_row(next, row2);
            load_entry(row2[0], lane, second.dp, second.dn, second.shifts);
            next += ROW_WORDS(HEADS);
#define ADD_TWO(h) ADD(h) heads[h] = with_second(heads[h], row2[1u + h]);
            EACH_HEAD(ADD_TWO)
        } else
#endif
        { EACH_HEAD(ADD) }
    } while (next < end);

    // Sources are loaded after the loop, where they are not in the way of what is added; and all of them before the first
    // is stored, since a tile may have an instance several times (plan.comp fills tiles up).
    uint slots[TILE];
    uint rebuilt = ITEM_WORD(3u);
#define SLOTS(h) slots[h] = ITEM_WORD(4u + h);
    EACH_HEAD(SLOTS)
    if (REBUILT_ITEMS) {
#ifndef INTEGER_POSES
        Head base;
        BASE
#define BASE_OF(h) heads[h] = plus(heads[h], base);
        EACH_HEAD(BASE_OF)
#endif
    } else {
#define SOURCE(h) heads[h] = plus(heads[h], loaded(slots[h], at, rebuilt >> h));
        EACH_HEAD(SOURCE)
    }
#define STORE(h) store(heads[h], slots[h], at);
    EACH_HEAD(STORE)
}
