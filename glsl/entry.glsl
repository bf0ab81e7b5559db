// Decoding of block entries, in units of the mesh's steps. The same arithmetic as src/mesh/packed/entry.rs.

// fast: 15 bits a component of positions, 9 of normals, in two words and a byte.
void decode_fast(uint a, uint b, int c, out ivec3 position, out ivec3 normal) {
    position = ivec3(bitfieldExtract(int(a), 0, 15), bitfieldExtract(int(a), 15, 15), bitfieldExtract(int(b), 0, 15));
    normal = ivec3(bitfieldExtract(int(b), 15, 9), (int(b) >> 24) * 2 + int((a >> 30) & 1u), c * 2 + int(a >> 31));
}

// small: the component of a record (96 bits at most) that starts at bit `at` and has `width` bits; 0 for no bits.
int record_field(uvec3 record, uint at, uint width) {
    uint low = at < 32u ? record.x : (at < 64u ? record.y : record.z);
    uint high = at < 32u ? record.y : (at < 64u ? record.z : 0u);
    uint shift = at & 31u;
    // Two shifts: one by 32 would be undefined.
    uint bits = (low >> shift) | ((high << 1) << (31u - shift));
    int field = int(bits << ((32u - width) & 31u)) >> ((32u - width) & 31u);
    return width == 0u ? 0 : field;
}
