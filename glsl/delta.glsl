// Decoding of deltas. Layout: src/pack/mod.rs.

// Factor from the coefficient of positions to that of normals, 2^exponent; `exponents` holds one signed byte
// per target, four to a word.
float normal_ratio(uint exponents, uint index) {
    int exponent = bitfieldExtract(int(exponents), int(8 * (index & 3u)), 8);
    return uintBitsToFloat(uint(exponent + 127) << 23);
}

// snorm16: two signed 16-bit integers to a word, in quantised units.
void decode_snorm16(uvec3 words, out vec3 position, out vec3 normal) {
    ivec3 low = bitfieldExtract(ivec3(words), 0, 16);
    ivec3 high = bitfieldExtract(ivec3(words), 16, 16);
    position = vec3(low.x, high.x, low.y);
    normal = vec3(high.y, low.z, high.z);
}
