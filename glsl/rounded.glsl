// Rounding to the unit of a fixed-point pose: of the amount that a target adds, as a function of the target's weight
// alone, so that sums do not depend on the history; or once, of the sum over all targets.

// The weight that the pose will hold, and the one that it holds, 16 bits each.
ivec2 two_weights(uint bits) {
    return ivec2(bitfieldExtract(int(bits), 0, 16), int(bits) >> 16);
}

// At most 31 bits are dropped, and no value with a half exceeds 32 bits.
#define ROUNDED(value, dropped) ((value) + ivec3(uvec3(1u) << (dropped) >> 1) >> (dropped))

// Low bits to drop of three components, five bits for each, from component `first` on.
uvec3 dropped_of(uint word, uint first) {
    return uvec3(word >> 5u * first, word >> 5u * (first + 1u), word >> 5u * (first + 2u)) & 31u;
}

ivec3 rounded_term(int weight, ivec3 delta, uvec3 dropped) {
    return ROUNDED(weight * delta, dropped);
}

// The difference of the two amounts.
ivec3 rounded_product(ivec2 weights, ivec3 delta, uvec3 dropped) {
    return rounded_term(weights.x, delta, dropped) - rounded_term(weights.y, delta, dropped);
}
