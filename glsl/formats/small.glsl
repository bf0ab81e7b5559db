// small: as few bits as an entry needs, for the vertices that it moves only. CPU: src/pack/formats/small.rs.

#define INTEGERS
#define DELTA ivec3
#ifndef HAS_FEW_REGISTERS
const bool FEW_REGISTERS = false;
#endif

// The next component of a record, whose width and offset are the lowest of `word`.
int next_component(inout uvec3 record, uint word) {
    uint width = word & 31u;
    int least = bitfieldExtract(int(word), 15, 5) << width >> 3;
    uvec3 rest = record >> width;
    int integer = int(record.x ^ (rest.x << width));
    // Two shifts: one by 32 would be undefined.
    record = rest | ((uvec3(record.yz, 0u) << 1) << (width ^ 31u));
    return least + integer;
}

void load_entry(uint entry, uint lane, out DELTA position[VERTICES], out DELTA normal[VERTICES], out uvec2 shifts) {
    shifts = uvec2(0u);
    uint header = headers_at + 3u * entry;
    uint at = deltas_at + asset[header];
    uvec2 words = uvec2(asset[header + 1u], asset[header + 2u]);
    // The widths of all components, added up three at a time.
    uint sums = (words.x & 0x7c1fu) + (words.y & 0x7c1fu) + (words.x >> 5 & 31u) + (words.y >> 5 & 31u);
    uint size = (sums & 0x3ffu) + (sums >> 10);
    // Without a mask each vertex has a record; a vertex without a record reads that of another.
    bool masked = int(words.x) < 0;
    uint mask_at = at + lane / 32u, bit = lane & 31u;
    uint mask = masked ? asset[mask_at] : ~0u;
    uint rank = uint(bitCount(mask & ((1u << bit) - 1u)));
    for (uint i = 1u; i < BLOCK_SIZE / 32u; ++i) {
        if (i <= lane / 32u) rank += masked ? uint(bitCount(asset[mask_at - i])) : 32u;
    }
    if (masked) at += BLOCK_SIZE / 32u;
    int moves = bitfieldExtract(int(mask), int(bit), 1);
    // The words after a record are loaded with it. After the last record there is the base pose.
    uint from = rank * size;
    at += from >> 5;
    uint shift = from & 31u;
    uvec4 four = uvec4(asset[at], asset[at + 1u], asset[at + 2u], asset[at + 3u]);
    uvec3 record = (four.xyz >> shift) | ((four.yzw << 1) << (shift ^ 31u));
    // While the record is being loaded, compilers compute widths and offsets of all components, which takes two
    // registers each. A zero that they cannot recognise, a bit that headers do not use, makes those of the first triple
    // wait for the record, and those of the second for the first.
    uint late = FEW_REGISTERS ? words.y >> 31 : 0u;
    words.x |= four.w & late;
    // One after the other: compilers take more registers if they see all six at once.
    for (uint c = 0u; c < 6u; ++c) {
        if (c == 3u) {
            position[0] = normal[0];
            words.x = words.y | (record.x & late);
        }
        normal[0] = ivec3(normal[0].yz, next_component(record, words.x) & moves);
        words.x >>= 5;
    }
}
