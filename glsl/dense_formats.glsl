// Deltas of a dense format: `format.glsl` is the file of the module's format under formats/, as build.rs resolves it.
// With DELTAS_BINDING they are in a storage buffer, row by row:
//     add_delta(row, coefficient, normal_coefficient, position, normal)
// adds the deltas of one target times its coefficients. Otherwise the deltas of BATCH targets are vertex attributes:
//     ADD_ATTRIBUTES(i, position, normal)
// adds the deltas of target i times its coefficient in the push constants.

// Factor from the coefficient of the first triple to that of the second, 2^exponent; `exponents` holds one signed byte
// per target, four to a word.
float normal_ratio(uint exponents, uint index) {
    int exponent = bitfieldExtract(int(exponents), int(8 * (index & 3u)), 8);
    return uintBitsToFloat(uint(exponent + 127) << 23);
}

#include "format.glsl"
