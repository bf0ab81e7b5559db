// crowd.comp for software drivers, where each access costs time per lane, and each subgroup of a workgroup as well: a
// lane has eight vertices, or four of a block of 32 (so a block is one subgroup), loads four words at once from texel
// buffers and stores two at once as a 64-bit integer. Loops over arrays are unrolled: an array indexed by a variable
// would live in memory.
#version 450
#extension GL_GOOGLE_include_directive : require
#define TEXELS
#include "abi.glsl"
#include "blocks.glsl"
#include "tiles.glsl"
#include "crowd_constants.glsl"

#ifndef PARTS
#define load_part(entry, lane, part, position, normal, shifts) load_entry(entry, lane, position, normal, shifts)
#endif

// Rows per iteration. With several instances their sums live in memory; two rows at a time load and store them half as
// often.
#define AT_ONCE min(INSTANCES, 2u)

#define LOAD_WORDS(words, count, buffer, at) \
    [[unroll]] for (uint i = 0u; i < (count); i += 4u) { \
        uvec4 four = texelFetch(buffer, int(((at) + i) / 4u)); \
        [[unroll]] for (uint j = 0u; j < 4u; ++j) words[i + j] = four[j]; \
    }

// An entry, then its coefficients.
void load_row(uint at, out uint row[ROW_WORDS(TILE)]) {
    if (INSTANCES == 1u) {
        uvec4 two = texelFetch(work, int(at / 4u));
        uvec2 one = (at & 2u) == 0u ? two.xy : two.zw;
        row[0] = one.x;
        row[1] = one.y;
        return;
    }
    LOAD_WORDS(row, ROW_WORDS(INSTANCES), work, at)
}

// The base pose, the same for all instances, from number `at` on.
void load_base(uint at, out NUMBER numbers[NUMBERS]) {
    uint words[NUMBERS];
#ifdef ROUNDED_PRODUCTS
    if (ROUNDED_SUMS)
#endif
    {
        LOAD_WORDS(words, NUMBERS, base, base_at + at)
        [[unroll]] for (uint i = 0u; i < NUMBERS; ++i) numbers[i] = NUMBER_OF(words[i]);
    }
#ifdef ROUNDED_PRODUCTS
    else {
        LOAD_WORDS(words, NUMBERS / 2u, base, base_at + at / 2u)
        [[unroll]] for (uint i = 0u; i < NUMBERS; i += 2u) { UNPACK(numbers, i, words[i / 2u]) }
    }
#endif
}

void main() {
    uint item[TILE_WORDS];
    LOAD_WORDS(item, 4u + INSTANCES, work, first_item + gl_WorkGroupID.x * TILE_WORDS)
    uint next = item[1], end = next + item[2] * ROW_WORDS(INSTANCES);
    uint lane = gl_LocalInvocationID.x;
    uint at = (item[0] * BLOCK_SIZE + lane * VERTICES) * 6u;

    NUMBER added[INSTANCES][NUMBERS];
    [[unroll]] for (uint h = 0u; h < INSTANCES; ++h) {
        [[unroll]] for (uint i = 0u; i < NUMBERS; ++i) added[h][i] = NUMBER(0);
    }

    // There is at least one row: a loop that tests first would run its body once more, for no lane.
    uint part = 0u; // what is next of the row's entry
    do {
        uint row[2][ROW_WORDS(TILE)];
        ivec3 dp[2][VERTICES], dn[2][VERTICES];
        uvec2 shifts[2];
        [[unroll]] for (uint r = 0u; r < AT_ONCE; ++r) {
            // The last row may be single: it is then loaded twice, and counts once.
            bool again = r == 1u && next == end;
            load_row(again ? next - ROW_WORDS(INSTANCES) : next, row[r]);
            if (r == 1u) {
                [[unroll]] for (uint h = 0u; h < INSTANCES; ++h) row[r][1u + h] = again ? 0u : row[r][1u + h];
            }
            uint later = part;
            load_part(row[r][0], lane, later, dp[r], dn[r], shifts[r]);
            RAISE(shifts[r])
            part = again ? 0u : later;
            next += again || part != 0u ? 0u : ROW_WORDS(INSTANCES);
        }
        [[unroll]] for (uint h = 0u; h < INSTANCES; ++h) {
            FACTOR p[2], n[2];
            [[unroll]] for (uint r = 0u; r < AT_ONCE; ++r) {
                p[r] = FACTOR_OF(row[r][1u + h], position_unit, shifts[r].x);
                n[r] = FACTOR_OF(row[r][1u + h], normal_unit, shifts[r].y);
            }
            [[unroll]] for (uint v = 0u; v < VERTICES; ++v) {
                ADDEND position = TIMES(p[0], dp[0][v]);
                ADDEND normal = TIMES(n[0], dn[0][v]);
                [[unroll]] for (uint r = 1u; r < AT_ONCE; ++r) {
                    position += TIMES(p[r], dp[r][v]);
                    normal += TIMES(n[r], dn[r][v]);
                }
                [[unroll]] for (uint c = 0u; c < 3u; ++c) {
                    added[h][6u * v + c] += position[c];
                    added[h][6u * v + 3u + c] += normal[c];
                }
            }
        }
    } while (next < end);

    // Poses are loaded after the loop, so that they do not take registers in it. Only tiles that the GPU plans, for
    // integers, have instances of both kinds: a branch would run for those that do not, too, and for each lane.
    uint rebuilt = item[3];
#ifdef INTEGER_POSES
#define STARTS_FROM_BASE(h) (ALL_REBUILT || (rebuilt >> (h) & 1u) != 0u)
    const bool loads_base = true;
#else
#define STARTS_FROM_BASE(h) ALL_REBUILT
    const bool loads_base = ALL_REBUILT;
#endif
    NUMBER numbers[NUMBERS];
    if (loads_base) load_base(at, numbers);

#ifdef ROUNDED_PRODUCTS
    if (ROUNDED_SUMS) {
        [[unroll]] for (uint h = 0u; h < INSTANCES; ++h) {
            [[unroll]] for (uint i = 0u; i < NUMBERS; i += 3u) {
                ivec3 sum = ivec3(added[h][i], added[h][i + 1u], added[h][i + 2u]);
                sum += STARTS_FROM_BASE(h) ? ivec3(numbers[i], numbers[i + 1u], numbers[i + 2u]) : ivec3(0);
                sum = ROUNDED(sum);
                [[unroll]] for (uint c = 0u; c < 3u; ++c) added[h][i + c] = sum[c];
            }
        }
        // They have the base pose now.
        [[unroll]] for (uint i = 0u; i < NUMBERS; ++i) numbers[i] = NUMBER(0);
    }
#endif

    // All sources are loaded before the first is stored, since a tile may have an instance several times: plans of the
    // GPU fill tiles up.
    [[unroll]] for (uint h = 0u; h < INSTANCES; ++h) {
        NUMBER source[NUMBERS];
        if (LOADS_POSES) load_vertices((item[4u + h] & 0xffffu) * pose_floats + at, source);
        [[unroll]] for (uint i = 0u; i < NUMBERS; ++i) added[h][i] += STARTS_FROM_BASE(h) ? numbers[i] : source[i];
    }
    [[unroll]] for (uint h = 0u; h < INSTANCES; ++h) store_vertices((item[4u + h] >> 16) * pose_floats + at, added[h]);
}
