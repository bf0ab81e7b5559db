// A vertex has six words, one for each number. The format that includes this defines
//     NUMBER, ADDEND             a number, and three
//     NUMBER_OF(word)            the number that has these bits, and the reverse
//     WORD_OF(number)

#ifdef TEXELS
// What is loaded as texels is stored as integers.
ALIASED layout(set = 0, binding = POSES_BINDING, std430) buffer Poses { uint64_t poses[]; };
ALIASED layout(set = 0, binding = POSES_BINDING + 1, rgba32ui) uniform uimageBuffer pose_texels;

void load_vertices(uint at, out NUMBER numbers[NUMBERS]) {
    [[unroll]] for (uint i = 0u; i < NUMBERS; i += 4u) {
        uvec4 four = imageLoad(pose_texels, int((at + i) / 4u));
        [[unroll]] for (uint j = 0u; j < 4u; ++j) numbers[i + j] = NUMBER_OF(four[j]);
    }
}

void store_vertices(uint at, NUMBER numbers[NUMBERS]) {
    [[unroll]] for (uint i = 0u; i < NUMBERS; i += 2u) {
        poses[(at + i) / 2u] = packUint2x32(uvec2(WORD_OF(numbers[i]), WORD_OF(numbers[i + 1u])));
    }
}
#else
layout(set = 0, binding = POSES_BINDING, std430) buffer Poses { NUMBER poses[]; };

void load_vertex(uint at, out ADDEND position, out ADDEND normal) {
    position = ADDEND(poses[at], poses[at + 1u], poses[at + 2u]);
    normal = ADDEND(poses[at + 3u], poses[at + 4u], poses[at + 5u]);
}

void store_vertex(uint at, ADDEND position, ADDEND normal) {
    poses[at] = position.x;
    poses[at + 1u] = position.y;
    poses[at + 2u] = position.z;
    poses[at + 3u] = normal.x;
    poses[at + 4u] = normal.y;
    poses[at + 5u] = normal.z;
}
#endif
