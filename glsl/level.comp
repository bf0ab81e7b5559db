// Chooses how many targets each instance keeps, from its size on the screen, and the error budget for that size. An
// invocation processes one instance. CPU twin: lod::Level::step, without weights.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "abi.glsl"

layout(local_size_x = WORKGROUP) in;

// At `reaches_at`: [rank] the farthest that the target moves a vertex at weight 1, then [targets kept] the error of a
// vertex, both float32 in input units.
layout(set = 0, binding = 0, std430) readonly buffer Tables { uint tables[]; };
// As in animation.glsl.
layout(set = 0, binding = 1, std430) buffer State { uint state[]; };

layout(push_constant) uniform Push {
    vec3 eye;          // world units
    float unit_at_one; // pixels that a world unit takes up at distance 1
    float exceeded;    // pixels: more are kept if a vertex may be off by more
    float wanted;      // pixels: fewer are kept once a vertex is off by no more with them
    float fade;        // pixels that a vertex may move because the level changes
    float budget;      // error budget at one pixel per input unit, in steps of a weight times steps of a delta
    uint heads;
    uint targets;
    uint words;        // of a bit for each target
    uint phases_at;    // in State
    uint reaches_at;   // in Tables
    uint pinned;       // targets that are always kept
    uint budget_at;    // in Tables: the crowd's error budget, the lower word first; 0: it has none
    uint epoch;        // grows where the camera cuts
};

const uint WHOLE = 0x10000u;

float error_of(uint kept) {
    return uintBitsToFloat(tables[reaches_at + targets + kept]);
}

// Returns the fewest targets with which no vertex is off by more than `pixels`. Errors do not grow with targets, and
// are 0 with all.
uint level_for(float unit, float pixels) {
    uint low = pinned, high = targets;
    while (low < high) {
        uint middle = (low + high) >> 1;
        if (error_of(middle) * unit <= pixels) high = middle;
        else low = middle + 1u;
    }
    return low;
}

// Moves from `level` towards `goal`, both in steps of 2⁻¹⁶, as far as the fade allows, and by at least one step.
uint towards(uint level, uint goal, float unit) {
    float room = fade;
    uint at = level;
    while (at != goal) {
        // The target that fades, and the level at which it is fully in or out.
        bool rises = goal > at;
        uint rank = (rises ? at : at - 1u) >> 16;
        uint left = rises ? (rank + 1u) * WHOLE - at : at - rank * WHOLE;
        float whole = uintBitsToFloat(tables[reaches_at + rank]) * unit;
        float cost = whole * float(left) / float(WHOLE);
        if (cost <= room) {
            room -= cost;
        } else {
            uint steps = min(uint(room / whole * float(WHOLE)), left);
            return rises ? at + max(steps, uint(at == level)) : at - max(steps, uint(at == level));
        }
        at = rises ? at + left : at - left;
    }
    return at;
}

void main() {
    uint head = gl_GlobalInvocationID.x + gl_GlobalInvocationID.y * gl_NumWorkGroups.x * gl_WorkGroupSize.x;
    if (head >= heads) return;
    uint record = head * RECORD_WORDS;
    uint flags = state[record + 3u];
    if ((flags & FOLLOWS) == 0u || (flags & HIDDEN) != 0u) return;
    vec3 centre = vec3(
        uintBitsToFloat(state[record + 8u]), uintBitsToFloat(state[record + 9u]), uintBitsToFloat(state[record + 10u]));
    float radius = uintBitsToFloat(state[record + 11u]);
    // Distance from the nearest point of the ball; inside it, a thousandth of its radius.
    float away = max(distance(eye, centre) - radius, radius * 1e-3);
    float unit = unit_at_one * uintBitsToFloat(state[record + 12u]) / away;
    uint epoch_now = epoch + state[record + 13u];

    uint at = heads * RECORD_WORDS + head * LEVEL_WORDS;
    uint level = state[at], goal = state[at + 1u];
    bool known = state[phases_at + head * words] != NEW && state[at + 2u] == epoch_now;
    // All targets if this is NaN, or too large.
    if (!(unit < 1e30)) {
        goal = targets;
        level = targets * WHOLE;
    } else {
        uint fewest = level_for(unit, wanted);
        if (!known || error_of(goal) * unit > exceeded || fewest < goal) goal = fewest;
        level = known ? towards(level, goal * WHOLE, unit) : goal * WHOLE;
    }
    state[at] = level;
    // The level that sampling reads: at most what the host allows.
    state[record + 6u] = min(level, state[record + 14u]);
    state[at + 1u] = goal;
    state[at + 2u] = epoch_now;
    if (budget_at == 0u) return;
    // At most the crowd's own budget.
    float most = unit < 1e30 ? min(budget / unit, 1e18) : 0.0;
    uint high = uint(most / 4294967296.0);
    uint low = uint(most - float(high) * 4294967296.0);
    uint whole_low = tables[budget_at], whole_high = tables[budget_at + 1u];
    bool less = high < whole_high || (high == whole_high && low < whole_low);
    state[at + 3u] = less ? low : whole_low;
    state[at + 4u] = less ? high : whole_high;
}
