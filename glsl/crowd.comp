// One workgroup updates one block of up to HEADS instances, all of its vertices: pose = source + Σ coefficient · delta.
// The deltas of an entry are loaded and decoded once for all of them; rows of the work list have a coefficient for each.
// CPU twin: cpu::crowd::Tile::run.
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

void main() {
    uint item = first_item + gl_WorkGroupID.x * ITEM_WORDS;
    uint row = work[item + 1u];
    uint end = row + work[item + 2u] * (HEADS + 1u);
    uint lane = gl_LocalInvocationID.x;
    uint at = (work[item] * BLOCK_SIZE + lane * VERTICES) * 6u;

    ADDEND position[HEADS * VERTICES];
    ADDEND normal[HEADS * VERTICES];
    for (uint i = 0u; i < HEADS * VERTICES; ++i) {
        position[i] = ADDEND(0);
        normal[i] = ADDEND(0);
    }
#ifdef EXACT
    uint rebuilt = work[item + 3u];
    float base[VERTICES * 6u];
    for (uint i = 0u; i < VERTICES * 6u; ++i) base[i] = uintBitsToFloat(asset[base_at + at + i]);
    int before[HEADS * VERTICES * 6u];
    for (uint h = 0u; h < HEADS; ++h) {
        uint from = (work[item + 4u + h] >> 16) / slots * pose_floats + at;
        int keep = int(rebuilt >> h & 1u) - 1;
        for (uint i = 0u; i < VERTICES * 6u; ++i) before[h * VERTICES * 6u + i] = sums[from + i] & keep;
    }
#else
    float before[HEADS * VERTICES * 6u];
    for (uint h = 0u; h < HEADS; ++h) {
        uint from = (work[item + 4u + h] & 0xffffu) * pose_floats + at;
        for (uint i = 0u; i < VERTICES * 6u; ++i) {
            before[h * VERTICES * 6u + i] = REBUILT_ITEMS ? uintBitsToFloat(asset[base_at + at + i]) : poses[from + i];
        }
    }
#endif

    for (; row < end; row += HEADS + 1u) {
        DELTA dp[VERTICES], dn[VERTICES];
        uvec2 shifts;
        load_entry(work[row], lane, dp, dn, shifts);
        for (uint h = 0u; h < HEADS; ++h) {
            uint coefficient = work[row + 1u + h];
            ADDEND p = ADDEND(COEFFICIENT(coefficient, position_unit, shifts.x));
            ADDEND n = ADDEND(COEFFICIENT(coefficient, normal_unit, shifts.y));
            for (uint v = 0u; v < VERTICES; ++v) {
                position[h * VERTICES + v] += p * ADDEND(dp[v]);
                normal[h * VERTICES + v] += n * ADDEND(dn[v]);
            }
        }
    }

    for (uint h = 0u; h < HEADS; ++h) {
        uint to = (work[item + 4u + h] >> 16);
#ifdef EXACT
        uint of_sums = to / slots * pose_floats + at;
#endif
        to = to * pose_floats + at;
        for (uint v = 0u; v < VERTICES; ++v) {
            uint i = h * VERTICES + v;
            for (uint c = 0u; c < 6u; ++c) {
                uint k = 6u * v + c;
#ifdef EXACT
                int sum = before[6u * i + c] + (c < 3u ? position[i][c] : normal[i][c - 3u]);
                sums[of_sums + k] = sum;
                // The product is exact, the unit being a power of two; sums above 24 bits are rounded before.
                precise float value = base[k] + float(sum) * (c < 3u ? position_unit : normal_unit);
                poses[to + k] = value;
#else
                poses[to + k] = before[6u * i + c] + (c < 3u ? position[i][c] : normal[i][c - 3u]);
#endif
            }
        }
    }
}
