// The amount that a target adds to a fixed-point pose, rounded to its unit as a function of the target's weight alone,
// so that sums do not depend on the history.

// The weight that the pose will hold, and the one that it holds, 16 bits each.
ivec2 two_weights(uint bits) {
    return ivec2(bitfieldExtract(int(bits), 0, 16), int(bits) >> 16);
}

ivec3 rounded_term(int weight, ivec3 delta, uint dropped) {
    int half_a_unit = int(1u << dropped >> 1);
    return weight * delta + half_a_unit >> dropped;
}

// The difference of the two amounts: at most 31 bits are dropped, and no product with a half exceeds 32 bits.
ivec3 rounded_product(ivec2 weights, ivec3 delta, uint dropped) {
    return rounded_term(weights.x, delta, dropped) - rounded_term(weights.y, delta, dropped);
}
