// Poses as software drivers load and store them: four words at once as a texel, two as a 64-bit integer. The including
// format defines
//     NUMBERS_OF_WORD              1u or 2u
//     UNPACK(numbers, i, word)     the numbers of a word, from numbers[i] on, and the reverse
//     PACK(numbers, i)

// The memory that is loaded as texels is stored as integers.
ALIASED layout(set = 0, binding = POSES_BINDING, std430) buffer Poses { uint64_t poses[]; };
ALIASED layout(set = 0, binding = POSES_BINDING + 1, rgba32ui) uniform uimageBuffer pose_texels;

void load_vertices(uint at, out NUMBER numbers[NUMBERS]) {
    [[unroll]] for (uint i = 0u; i < NUMBERS; i += 4u * NUMBERS_OF_WORD) {
        uvec4 four = imageLoad(pose_texels, int((at + i) / (4u * NUMBERS_OF_WORD)));
        [[unroll]] for (uint j = 0u; j < 4u; ++j) { UNPACK(numbers, i + NUMBERS_OF_WORD * j, four[j]) }
    }
}

void store_vertices(uint at, NUMBER numbers[NUMBERS]) {
    [[unroll]] for (uint i = 0u; i < NUMBERS; i += 2u * NUMBERS_OF_WORD) {
        uvec2 two = uvec2(PACK(numbers, i), PACK(numbers, i + NUMBERS_OF_WORD));
        poses[(at + i) / (2u * NUMBERS_OF_WORD)] = packUint2x32(two);
    }
}
