// Rounding to the unit of a fixed-point pose: of the amount that a target adds, as a function of the target's weight
// alone, so that sums do not depend on the history; or once, of the sum over all targets.

// The weight that the pose will hold, and the one that it holds, 16 bits each.
ivec2 two_weights(uint bits) {
    return ivec2(bitfieldExtract(int(bits), 0, 16), int(bits) >> 16);
}

// The low bits to drop, at most 31, and half of what the lowest bit that is left stands for. No value with a half exceeds
// 32 bits.
#define ROUNDED(value, rounding) ((value) + int((rounding).y) >> (rounding).x)

uvec2 rounding_of(uint dropped) {
    return uvec2(dropped, 1u << dropped >> 1);
}

ivec3 rounded_term(int weight, ivec3 delta, uvec2 rounding) {
    return ROUNDED(weight * delta, rounding);
}

// The difference of the two amounts.
ivec3 rounded_product(ivec2 weights, ivec3 delta, uvec2 rounding) {
    return rounded_term(weights.x, delta, rounding) - rounded_term(weights.y, delta, rounding);
}
