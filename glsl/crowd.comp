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
#ifndef EXACT
// Instances that start from the base pose are in items of their own, which load it once.
layout(constant_id = 4) const bool REBUILT_ITEMS = false;
#endif

// Numbers of a lane's vertices.
const uint NUMBERS = 6u * VERTICES;

#ifdef EXACT
#define NUMBER int
#else
#define NUMBER float
#endif

// What is loaded and stored: numbers and words that lie one after the other, from a texel on. LOAD_POSE and
// STORE_POSE_NUMBERS are the pose format's (pose.glsl).
#ifdef TEXELS
#define LOAD(type, value, count, texel) \
    [[unroll]] for (uint i = 0u; i < (count); i += 4u) { \
        type four = texel; \
        value[i] = four.x; value[i + 1u] = four.y; value[i + 2u] = four.z; value[i + 3u] = four.w; \
    }
#define TEXEL(at) int(((at) + i) / 4u)
#define LOAD_WORDS(value, count, at) LOAD(uvec4, value, count, texelFetch(work, TEXEL(at)))
#define LOAD_BASE(value, at) LOAD(vec4, value, NUMBERS, uintBitsToFloat(texelFetch(asset, TEXEL(base_at + (at)))))
#define LOAD_SUMS(value, at) LOAD(ivec4, value, NUMBERS, imageLoad(sum_texels, TEXEL(at)))
#define STORE(pairs, at, value) \
    [[unroll]] for (uint i = 0u; i < NUMBERS; i += 2u) { \
        pairs[((at) + i) / 2u] = packUint2x32(uvec2(BITS(value(i)), BITS(value(i + 1u)))); \
    }
uint BITS(float value) { return floatBitsToUint(value); }
uint BITS(int value) { return uint(value); }
#else
#define LOAD(value, count, loaded) [[unroll]] for (uint i = 0u; i < (count); ++i) value[i] = loaded;
#define LOAD_WORDS(value, count, at) LOAD(value, count, work[(at) + i])
#define LOAD_BASE(value, at) LOAD(value, NUMBERS, uintBitsToFloat(asset[base_at + (at) + i]))
#define LOAD_SUMS(value, at) LOAD(value, NUMBERS, sums[(at) + i])
#define STORE(numbers, at, value) [[unroll]] for (uint i = 0u; i < NUMBERS; ++i) numbers[(at) + i] = value(i);
#endif

// What is stored of the instance h.
#define SUM(i) added[h][i]
#ifdef EXACT
// The product is exact, the unit being a power of two; sums above 24 bits are rounded before.
#define POSE(i) decode(base[i], added[h][i], (i) % 6u < 3u ? position_unit : normal_unit)
float decode(float base, int sum, float unit) {
    precise float decoded = base + float(sum) * unit;
    return decoded;
}
#else
#define POSE(i) added[h][i]
#endif

// An entry, then its coefficients.
void load_row(uint at, out uint row[ROW_WORDS(TILE)]) {
#ifdef TEXELS
    if (HEADS == 1u) {
        uvec4 two = texelFetch(work, int(at / 4u));
        uvec2 one = (at & 2u) == 0u ? two.xy : two.zw;
        row[0] = one.x;
        row[1] = one.y;
        return;
    }
#endif
    LOAD_WORDS(row, ROW_WORDS(HEADS), at)
}

void main() {
    uint item[TILE_WORDS];
    LOAD_WORDS(item, 4u + HEADS, first_item + gl_WorkGroupID.x * TILE_WORDS)
    uint next = item[1], end = next + item[2] * ROW_WORDS(HEADS);
    uint lane = gl_LocalInvocationID.x;
    uint at = (item[0] * BLOCK_SIZE + lane * VERTICES) * 6u;

    // Loops are unrolled: arrays that are indexed by a variable would live in memory.
    NUMBER added[HEADS][NUMBERS];
    [[unroll]] for (uint h = 0u; h < HEADS; ++h) {
        [[unroll]] for (uint i = 0u; i < NUMBERS; ++i) added[h][i] = NUMBER(0);
    }

    // There is a row at least: a loop that asks first would run its body once more on software drivers, for no lane.
    // Two rows at a time, where there are several heads: what lives in memory is loaded and stored half as often.
    do {
        uint row[AT_ONCE][ROW_WORDS(TILE)];
        DELTA dp[AT_ONCE][VERTICES], dn[AT_ONCE][VERTICES];
        uvec2 shifts[AT_ONCE];
        [[unroll]] for (uint r = 0u; r < AT_ONCE; ++r) {
            load_row(next + r * ROW_WORDS(HEADS), row[r]);
            load_entry(row[r][0], lane, dp[r], dn[r], shifts[r]);
        }
        [[unroll]] for (uint h = 0u; h < HEADS; ++h) {
            ADDEND p[AT_ONCE], n[AT_ONCE];
            [[unroll]] for (uint r = 0u; r < AT_ONCE; ++r) {
                p[r] = ADDEND(COEFFICIENT(row[r][1u + h], position_unit, shifts[r].x));
                n[r] = ADDEND(COEFFICIENT(row[r][1u + h], normal_unit, shifts[r].y));
            }
            [[unroll]] for (uint v = 0u; v < VERTICES; ++v) {
                ADDEND position = p[0] * ADDEND(dp[0][v]), normal = n[0] * ADDEND(dn[0][v]);
                [[unroll]] for (uint r = 1u; r < AT_ONCE; ++r) {
                    position += p[r] * ADDEND(dp[r][v]);
                    normal += n[r] * ADDEND(dn[r][v]);
                }
                [[unroll]] for (uint c = 0u; c < 3u; ++c) {
                    added[h][6u * v + c] += position[c];
                    added[h][6u * v + 3u + c] += normal[c];
                }
            }
        }
        next += AT_ONCE * ROW_WORDS(HEADS);
    } while (next < end);

    // Sources are loaded after the loop, where they are not in the way of what is added; and all of them before the first
    // is stored, since a tile may have an instance several times (plan.comp fills tiles up).
#ifdef EXACT
    [[unroll]] for (uint h = 0u; h < HEADS; ++h) {
        int sum[NUMBERS];
        LOAD_SUMS(sum, (item[4u + h] >> 16) / slots * pose_floats + at)
        int keep = int(item[3] >> h & 1u) - 1;
        [[unroll]] for (uint i = 0u; i < NUMBERS; ++i) added[h][i] += sum[i] & keep;
    }
    float base[NUMBERS];
    LOAD_BASE(base, at)
#else
    float base[NUMBERS];
    if (REBUILT_ITEMS) { LOAD_BASE(base, at) }
    [[unroll]] for (uint h = 0u; h < HEADS; ++h) {
        float source[NUMBERS];
        if (REBUILT_ITEMS) source = base;
        else { LOAD_POSE(source, (item[4u + h] & 0xffffu) * pose_floats + at) }
        [[unroll]] for (uint i = 0u; i < NUMBERS; ++i) added[h][i] += source[i];
    }
#endif

    [[unroll]] for (uint h = 0u; h < HEADS; ++h) {
        uint pose = item[4u + h] >> 16;
#ifdef EXACT
        STORE(sums, pose / slots * pose_floats + at, SUM)
#endif
        STORE_POSE_NUMBERS(pose * pose_floats + at, POSE)
    }
}
