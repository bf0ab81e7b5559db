// fast: 15 bits per component of the first triple, 9 of the second, in two words and a byte. CPU:
// src/pack/formats/fast.rs.

void decode_fast(uint a, uint b, int c, out ivec3 position, out ivec3 normal) {
    position = ivec3(bitfieldExtract(int(a), 0, 15), bitfieldExtract(int(a), 15, 15), bitfieldExtract(int(b), 0, 15));
    normal = ivec3(bitfieldExtract(int(b), 15, 9), (int(b) >> 24) * 2 + int((a >> 30) & 1u), c * 2 + int(a >> 31));
}

void load_entry(uint entry, uint lane, out ivec3 position[VERTICES], out ivec3 normal[VERTICES], out uvec2 shifts) {
    shifts = uvec2(0u);
    uint at = deltas_at + entry * (BLOCK_SIZE / 4u * 9u);
#ifdef TEXELS
    uint header = texelFetch(asset, int(entry / 4u))[entry & 3u];
    // A word of bytes for four vertices, so that lanes share texels.
    uint first = lane * (VERTICES / 4u);
    uvec4 bytes = texelFetch(asset, int((at + 2u * BLOCK_SIZE + first) / 4u));
    uvec2 c = (first & 2u) == 0u ? bytes.xy : bytes.zw;
    if (VERTICES == 4u) c.x = (first & 1u) == 0u ? c.x : c.y;
    [[unroll]] for (uint q = 0u; q < VERTICES / 4u; ++q) {
        uint l = at / 4u + first + q;
        uvec4 a = texelFetch(asset, int(l)), b = texelFetch(asset, int(l + BLOCK_SIZE / 4u));
        [[unroll]] for (uint i = 0u; i < 4u; ++i) {
            int k = bitfieldExtract(int(c[q]), 8 * int(i), 8);
            decode_fast(a[i], b[i], k, position[4u * q + i], normal[4u * q + i]);
        }
    }
#else
    uint header = asset[entry];
    int c = bitfieldExtract(int(asset[at + 2u * BLOCK_SIZE + (lane >> 2)]), int(8u * (lane & 3u)), 8);
    decode_fast(asset[at + lane], asset[at + BLOCK_SIZE + lane], c, position[0], normal[0]);
#endif
    shifts = uvec2(header & 0xffu, (header >> 8) & 0xffu);
}
