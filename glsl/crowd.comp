// One workgroup updates one block of up to HEADS instances, all of its vertices: pose = source + Σ coefficient · delta.
// The deltas of an entry are loaded and decoded once for all of them; rows of the work list have a coefficient for each.
// CPU twin: cpu::tile::run.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "blocks.glsl"

layout(constant_id = 2) const uint HEADS = 1;
#ifndef EXACT
// Instances that start from the base pose are in items of their own: what is loaded under control flow costs software
// drivers several times as much.
layout(constant_id = 3) const bool REBUILT_ITEMS = false;
#endif

const uint ITEM_WORDS = 12u;
// Floats of a lane's vertices.
const uint FLOATS = 6u * VERTICES;

#ifdef TEXELS
#define LOAD(value, texel) \
    [[unroll]] for (uint i = 0u; i < FLOATS; i += 4u) { \
        vec4 t = texel; \
        value[i] = t.x; value[i + 1u] = t.y; value[i + 2u] = t.z; value[i + 3u] = t.w; \
    }
void load_base(uint at, out float value[FLOATS]) {
    LOAD(value, uintBitsToFloat(texelFetch(texels, int((base_at + at + i) / 4u))))
}
void load_pose(uint at, out float value[FLOATS]) { LOAD(value, imageLoad(poses, int((at + i) / 4u))) }
void store_pose(uint at, float value[FLOATS]) {
    [[unroll]] for (uint i = 0u; i < FLOATS; i += 4u) {
        imageStore(poses, int((at + i) / 4u), vec4(value[i], value[i + 1u], value[i + 2u], value[i + 3u]));
    }
}
#ifdef EXACT
void load_sums(uint at, out int value[FLOATS]) {
    [[unroll]] for (uint i = 0u; i < FLOATS; i += 4u) {
        ivec4 t = imageLoad(sums, int((at + i) / 4u));
        value[i] = t.x; value[i + 1u] = t.y; value[i + 2u] = t.z; value[i + 3u] = t.w;
    }
}
void store_sums(uint at, int value[FLOATS]) {
    [[unroll]] for (uint i = 0u; i < FLOATS; i += 4u) {
        imageStore(sums, int((at + i) / 4u), ivec4(value[i], value[i + 1u], value[i + 2u], value[i + 3u]));
    }
}
#endif
#else
#define EACH(statement) [[unroll]] for (uint i = 0u; i < FLOATS; ++i) statement
void load_base(uint at, out float value[FLOATS]) { EACH(value[i] = uintBitsToFloat(asset[base_at + at + i]);) }
void load_pose(uint at, out float value[FLOATS]) { EACH(value[i] = poses[at + i];) }
void store_pose(uint at, float value[FLOATS]) { EACH(poses[at + i] = value[i];) }
#ifdef EXACT
void load_sums(uint at, out int value[FLOATS]) { EACH(value[i] = sums[at + i];) }
void store_sums(uint at, int value[FLOATS]) { EACH(sums[at + i] = value[i];) }
#endif
#endif

void main() {
    uint item = first_item + gl_WorkGroupID.x * ITEM_WORDS;
    uint row = work[item + 1u];
    uint end = row + work[item + 2u] * (HEADS + 1u);
    uint lane = gl_LocalInvocationID.x;
    uint at = (work[item] * BLOCK_SIZE + lane * VERTICES) * 6u;

    // Loops are unrolled: arrays that are indexed by a variable would live in memory. What is loaded is loaded before
    // the loop over rows, whose control flow makes loads dear on software drivers.
#ifdef EXACT
    uint rebuilt = work[item + 3u];
    int sum[HEADS][FLOATS];
    [[unroll]] for (uint h = 0u; h < HEADS; ++h) {
        load_sums((work[item + 4u + h] >> 16) / slots * pose_floats + at, sum[h]);
        int keep = int(rebuilt >> h & 1u) - 1;
        [[unroll]] for (uint i = 0u; i < FLOATS; ++i) sum[h][i] &= keep;
    }
    float base[FLOATS];
    load_base(at, base);
#else
    float before[HEADS][FLOATS];
    float sum[HEADS][FLOATS];
    [[unroll]] for (uint h = 0u; h < HEADS; ++h) {
        if (REBUILT_ITEMS) load_base(at, before[h]);
        else load_pose((work[item + 4u + h] & 0xffffu) * pose_floats + at, before[h]);
        [[unroll]] for (uint i = 0u; i < FLOATS; ++i) sum[h][i] = 0.0;
    }
#endif

    for (; row < end; row += HEADS + 1u) {
        DELTA dp[VERTICES], dn[VERTICES];
        uvec2 shifts;
        load_entry(work[row], lane, dp, dn, shifts);
        [[unroll]] for (uint h = 0u; h < HEADS; ++h) {
            uint coefficient = work[row + 1u + h];
            ADDEND p = ADDEND(COEFFICIENT(coefficient, position_unit, shifts.x));
            ADDEND n = ADDEND(COEFFICIENT(coefficient, normal_unit, shifts.y));
            [[unroll]] for (uint v = 0u; v < VERTICES; ++v) {
                ADDEND position = p * ADDEND(dp[v]), normal = n * ADDEND(dn[v]);
                [[unroll]] for (uint c = 0u; c < 3u; ++c) {
                    sum[h][6u * v + c] += position[c];
                    sum[h][6u * v + 3u + c] += normal[c];
                }
            }
        }
    }

    [[unroll]] for (uint h = 0u; h < HEADS; ++h) {
        uint pose = work[item + 4u + h] >> 16;
        float value[FLOATS];
        [[unroll]] for (uint i = 0u; i < FLOATS; ++i) {
#ifdef EXACT
            // The product is exact, the unit being a power of two; sums above 24 bits are rounded before.
            precise float decoded = base[i] + float(sum[h][i]) * (i % 6u < 3u ? position_unit : normal_unit);
            value[i] = decoded;
#else
            value[i] = before[h][i] + sum[h][i];
#endif
        }
#ifdef EXACT
        store_sums(pose / slots * pose_floats + at, sum[h]);
#endif
        store_pose(pose * pose_floats + at, value);
    }
}
