// small: as few bits as an entry needs, for the vertices that it moves only. CPU: src/pack/formats/small.rs.

#ifdef TEXELS

// Three words from word `at` on.
uvec3 three_words(uint at) {
    uvec4 a = texelFetch(asset, int(at / 4u)), b = texelFetch(asset, int(at / 4u) + 1);
    uvec4 even = (at & 2u) == 0u ? a : uvec4(a.zw, b.xy);
    return (at & 1u) == 0u ? even.xyz : even.yzw;
}

uint one_word(uint at) {
    uvec4 a = texelFetch(asset, int(at / 4u));
    uvec2 two = (at & 2u) == 0u ? a.xy : a.zw;
    return (at & 1u) == 0u ? two.x : two.y;
}

// The 32 bits from bit `at` of two texels on, as far as they are in these.
uint bits_at(uvec4 a, uvec4 b, uint at) {
    uvec4 four = (at & 128u) == 0u ? a : b;
    uvec3 two = (at & 64u) == 0u ? four.xyz : uvec3(four.zw, b.x);
    uvec2 one = (at & 32u) == 0u ? two.xy : two.yz;
    return (one.x >> (at & 31u)) | ((one.y << 1) << (~at & 31u));
}

// A part is the components that lie within 32 bits of a record: mostly all. A loop over parts in here would store and
// mask each component once more.
#define PARTS
void load_part(uint entry, uint lane, inout uint part, out ivec3 position[VERTICES], out ivec3 normal[VERTICES],
               out uvec2 shifts) {
    shifts = uvec2(0u);
    uvec3 header = three_words(3u * entry);
    uint at = deltas_at + header.x, size = 0u, end = 0u;
    // Components of the part end behind its first bit, `part`, and 32 bits from it at most. Those without bits that are
    // the first of a record end at its bit 0.
    uint low = part == 0u ? 0u : part + 1u, span = part + 32u - low;
    uint begins[6], masks[6];
    int least[6];
    [[unroll]] for (uint c = 0u; c < 6u; ++c) {
        uint word = (c < 3u ? header.y : header.z) >> (5u * (c % 3u));
        uint width = word & 31u;
        begins[c] = size - part & 31u;
        size += width;
        bool is_in = size - low <= span;
        masks[c] = is_in ? ~(~0u << width) : 0u;
        least[c] = is_in ? bitfieldExtract(int(word), 15, 5) << width >> 3 : 0;
        if (is_in) end = size;
    }
    // Without a mask each vertex has a record; a vertex without a record reads that of another.
    bool masked = int(header.y) < 0;
    uint first = lane * VERTICES, rank = 0u, mask = 0u;
    [[unroll]] for (uint i = 0u; i < BLOCK_SIZE / 32u; ++i) {
        uint word = masked ? one_word(at + i) : ~0u;
        uint before = i < first / 32u ? ~0u : i == first / 32u ? (1u << (first & 31u)) - 1u : 0u;
        rank += uint(bitCount(word & before));
        if (i == first / 32u) mask = word >> (first & 31u);
    }
    if (masked) at += BLOCK_SIZE / 32u;
    // From the beginning of the texel that has word `at`. Two texels have two records, whatever their size.
    uint bit = (at & 3u) * 32u + rank * size + part;
    [[unroll]] for (uint v = 0u; v < VERTICES; v += 2u) {
        int texel = int(at / 4u + bit / 128u);
        uvec4 a = texelFetch(asset, texel), b = texelFetch(asset, texel + 1);
        uint place = bit & 127u;
        [[unroll]] for (uint w = 0u; w < 2u; ++w) {
            uint bits = bits_at(a, b, place);
            int moves = int(mask << (31u - (v + w))) >> 31;
            [[unroll]] for (uint c = 0u; c < 3u; ++c) {
                position[v + w][c] = (int((bits >> begins[c]) & masks[c]) + least[c]) & moves;
                normal[v + w][c] = (int((bits >> begins[3u + c]) & masks[3u + c]) + least[3u + c]) & moves;
            }
            place += uint(moves) & size;
            bit += uint(moves) & size;
        }
    }
    part = end == size ? 0u : end;
}

#else

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

void load_entry(uint entry, uint lane, out ivec3 position[VERTICES], out ivec3 normal[VERTICES], out uvec2 shifts) {
    shifts = uvec2(0u);
    uint header = 3u * entry;
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
    // All ones if bit `bit` is set. Not bitfieldExtract: of a mask that is the same for the subgroup, at a bit that differs
    // by invocation, NVIDIA's driver 580 takes the first invocation's bit for all (docs/results/gpu.md).
    int moves = int(mask << (31u - bit)) >> 31;
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

#endif
