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

// Words that lie one after the other. LOAD_POSE and STORE_POSE_NUMBERS are the pose format's (pose.glsl).
#ifdef TEXELS
#define LOAD_WORDS(value, count, buffer, at) \
    [[unroll]] for (uint i = 0u; i < (count); i += 4u) { \
        uvec4 four = texelFetch(buffer, int(((at) + i) / 4u)); \
        [[unroll]] for (uint j = 0u; j < 4u; ++j) value[i + j] = four[j]; \
    }
#else
#define LOAD_WORDS(value, count, buffer, at) [[unroll]] for (uint i = 0u; i < (count); ++i) value[i] = buffer[(at) + i];
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
    LOAD_WORDS(row, ROW_WORDS(HEADS), work, at)
}

void main() {
    uint item[TILE_WORDS];
    LOAD_WORDS(item, 4u + HEADS, work, first_item + gl_WorkGroupID.x * TILE_WORDS)
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
            FACTOR p[AT_ONCE], n[AT_ONCE];
            [[unroll]] for (uint r = 0u; r < AT_ONCE; ++r) {
                p[r] = FACTOR_OF(row[r][1u + h], position_unit, shifts[r].x);
                n[r] = FACTOR_OF(row[r][1u + h], normal_unit, shifts[r].y);
            }
            [[unroll]] for (uint v = 0u; v < VERTICES; ++v) {
                ADDEND position = TIMES(p[0], dp[0][v], position_dropped);
                ADDEND normal = TIMES(n[0], dn[0][v], normal_dropped);
                [[unroll]] for (uint r = 1u; r < AT_ONCE; ++r) {
                    position += TIMES(p[r], dp[r][v], position_dropped);
                    normal += TIMES(n[r], dn[r][v], normal_dropped);
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
#ifdef INTEGER_POSES
    if (REBUILT_ITEMS) {
        // A displacement of nothing.
    } else {
        [[unroll]] for (uint h = 0u; h < HEADS; ++h) {
            NUMBER source[NUMBERS];
            LOAD_POSE(source, (item[4u + h] & 0xffffu) * pose_floats + at)
            // Tiles that plan.comp fills have instances of both kinds.
            int keep = int(item[3] >> h & 1u) - 1;
            [[unroll]] for (uint i = 0u; i < NUMBERS; ++i) added[h][i] += source[i] & keep;
        }
    }
#else
    NUMBER base[NUMBERS];
    if (REBUILT_ITEMS) {
        uint words[NUMBERS];
        LOAD_WORDS(words, NUMBERS, asset, base_at + at)
        [[unroll]] for (uint i = 0u; i < NUMBERS; ++i) base[i] = uintBitsToFloat(words[i]);
    }
    [[unroll]] for (uint h = 0u; h < HEADS; ++h) {
        NUMBER source[NUMBERS];
        if (REBUILT_ITEMS) source = base;
        else { LOAD_POSE(source, (item[4u + h] & 0xffffu) * pose_floats + at) }
        [[unroll]] for (uint i = 0u; i < NUMBERS; ++i) added[h][i] += source[i];
    }
#endif

    [[unroll]] for (uint h = 0u; h < HEADS; ++h) STORE_POSE_NUMBERS((item[4u + h] >> 16) * pose_floats + at, added[h])
}
