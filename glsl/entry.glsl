// The entries of a mesh in blocks: loading and decoding. The same arithmetic as src/pack/entry.rs.
// Who includes this declares asset (words, with TEXELS texels), deltas_at, BLOCK_SIZE and VERTICES, and FAST or SMALL, or
// neither for float32.

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

#if defined(FAST) || defined(SMALL)
#define DELTA ivec3
#else
#define DELTA vec3
#endif

// What an entry adds to a lane's vertices at weight 1, in steps (float32: in input units); shifts of both, for `fast`.
void load_entry(uint entry, uint lane, out DELTA position[VERTICES], out DELTA normal[VERTICES], out uvec2 shifts) {
    shifts = uvec2(0u);
#if defined(FAST)
    uint at = deltas_at + entry * (BLOCK_SIZE / 4u * 9u);
#ifdef TEXELS
    uint header = texelFetch(asset, int(entry / 4u))[entry & 3u];
    // Two words of bytes for eight vertices, so that lanes share texels.
    uvec4 bytes = texelFetch(asset, int((at + 2u * BLOCK_SIZE) / 4u + lane / 2u));
    uvec2 c = (lane & 1u) == 0u ? bytes.xy : bytes.zw;
    [[unroll]] for (int q = 0; q < VERTICES / 4; ++q) {
        int l = int(lane) * (VERTICES / 4) + q;
        uvec4 a = texelFetch(asset, int(at / 4u) + l), b = texelFetch(asset, int((at + BLOCK_SIZE) / 4u) + l);
        [[unroll]] for (int i = 0; i < 4; ++i) {
            int k = bitfieldExtract(int(c[q]), 8 * i, 8);
            decode_fast(a[i], b[i], k, position[4 * q + i], normal[4 * q + i]);
        }
    }
#else
    uint header = asset[entry];
    int c = bitfieldExtract(int(asset[at + 2u * BLOCK_SIZE + (lane >> 2)]), int(8u * (lane & 3u)), 8);
    decode_fast(asset[at + lane], asset[at + BLOCK_SIZE + lane], c, position[0], normal[0]);
#endif
    shifts = uvec2(header & 0xffu, (header >> 8) & 0xffu);
#elif defined(SMALL)
    position[0] = ivec3(0);
    normal[0] = ivec3(0);
    uint header = entry * (2u + BLOCK_SIZE / 32u);
    uint word = lane >> 5;
    uint mask = asset[header + 2u + word];
    uint bit = lane & 31u;
    if ((mask >> bit & 1u) == 0u) return;
    // The place of the record among those of the vertices in the mask.
    uint rank = uint(bitCount(mask & ((1u << bit) - 1u)));
    for (uint i = 0u; i < word; ++i) rank += uint(bitCount(asset[header + 2u + i]));
    uint widths = asset[header + 1u];
    uvec3 wp = uvec3(widths, widths >> 5, widths >> 10) & 31u;
    uvec3 wn = uvec3(widths >> 15, widths >> 20, widths >> 25) & 31u;
    uvec3 ap = uvec3(0u, wp.x, wp.x + wp.y);
    uint half_record = ap.z + wp.z;
    uvec3 an = half_record + uvec3(0u, wn.x, wn.x + wn.y);
    uint size = an.z + wn.z;
    uint from = rank * size;
    uint at = deltas_at + asset[header] + (from >> 5);
    uint shift = from & 31u;
    // Load no word that the record does not reach.
    uint w0 = asset[at];
    uint w1 = shift + size > 32u ? asset[at + 1u] : 0u;
    uint w2 = shift + size > 64u ? asset[at + 2u] : 0u;
    uint w3 = shift + size > 96u ? asset[at + 3u] : 0u;
    uvec3 record = (uvec3(w0, w1, w2) >> shift) | ((uvec3(w1, w2, w3) << 1) << (31u - shift));
    position[0] = ivec3(record_field(record, ap.x, wp.x), record_field(record, ap.y, wp.y), record_field(record, ap.z, wp.z));
    normal[0] = ivec3(record_field(record, an.x, wn.x), record_field(record, an.y, wn.y), record_field(record, an.z, wn.z));
#else
    uint at = deltas_at + entry * (6u * BLOCK_SIZE) + lane;
    position[0] = vec3(uintBitsToFloat(asset[at]), uintBitsToFloat(asset[at + BLOCK_SIZE]),
                       uintBitsToFloat(asset[at + 2u * BLOCK_SIZE]));
    normal[0] = vec3(uintBitsToFloat(asset[at + 3u * BLOCK_SIZE]), uintBitsToFloat(asset[at + 4u * BLOCK_SIZE]),
                     uintBitsToFloat(asset[at + 5u * BLOCK_SIZE]));
#endif
}
