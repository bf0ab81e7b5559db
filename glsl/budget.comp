// With an error budget: if the deferred changes of a block could move a vertex further than the budget, all of them are
// applied. An invocation processes one block of one instance. CPU twin: update::animated::reference::Deferred::commit.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "animation.glsl"

// Levels of detail may follow the camera; each then has its own budget.
layout(constant_id = 0) const bool LEVELS = false;

void main() {
    uint block = gl_GlobalInvocationID.x;
    if (block >= blocks) return;
    uint from = tables[first_entry_at + block];
    uint to = tables[first_entry_at + block + 1u];
    // In steps of a weight times steps of a delta: 64 bits.
    uint whole_low = tables[budget_at];
    uint whole_high = tables[budget_at + 1u];
    for (uint head = gl_WorkGroupID.y; head < heads; head += gl_NumWorkGroups.y) {
        if (state[phases_at + head * words] != CONTINUED) continue;
        uint deferred = 0u;
        for (uint w = 0u; w < words; ++w) {
            deferred |= state[bits(PENDING) + head * words + w] & tables[block_targets_at + block * words + w];
        }
        if (deferred == 0u) continue;
        uint low = 0u, high = 0u;
        for (uint e = from; e < to; ++e) {
            uint at = head * targets + tables[entries_at + 2u * e];
            uint product_high, product_low, carry;
            uint pending = uint(abs(int(state[requested_at + at]) - int(state[weights_at + at])));
            umulExtended(pending, tables[budget_at + 2u + e], product_high, product_low);
            low = uaddCarry(low, product_low, carry);
            high += product_high + carry;
        }
        uint most_low = whole_low, most_high = whole_high;
        if (LEVELS && (state[head * RECORD_WORDS + 3u] & FOLLOWS) != 0u) {
            most_low = state[level_of(head) + 3u];
            most_high = state[level_of(head) + 4u];
        }
        if (high < most_high || (high == most_high && low <= most_low)) continue;
        for (uint w = 0u; w < words; ++w) {
            uint applied = state[bits(PENDING) + head * words + w] & tables[block_targets_at + block * words + w];
            if (applied != 0u) atomicOr(state[bits(APPLIED) + head * words + w], applied);
        }
    }
}
