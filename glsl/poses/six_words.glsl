// A vertex has six words, one for each number. The including format defines
//     NUMBER, ADDEND             a number, and three
//     NUMBER_OF(word)            the number that has these bits, and the reverse
//     WORD_OF(number)

// One after the other, unless vertex_offsets.glsl defines others elsewhere.
#ifndef HAS_OFFSETS
#define OFFSET_0 0u
#define OFFSET_1 1u
#define OFFSET_2 2u
#define OFFSET_3 3u
#define OFFSET_4 4u
#define OFFSET_5 5u
#define STORES(number) true
#endif

// A vertex in a storage buffer of numbers, beginning at number `at`.
#define LOAD_VERTEX(buffer, at, position, normal) { \
    uint first = at; \
    position = ADDEND(buffer[first + OFFSET_0], buffer[first + OFFSET_1], buffer[first + OFFSET_2]); \
    normal = ADDEND(buffer[first + OFFSET_3], buffer[first + OFFSET_4], buffer[first + OFFSET_5]); \
}
#define STORE_VERTEX(buffer, at, position, normal) { \
    uint first = at; \
    if (STORES(0u)) buffer[first + OFFSET_0] = position.x; \
    if (STORES(1u)) buffer[first + OFFSET_1] = position.y; \
    if (STORES(2u)) buffer[first + OFFSET_2] = position.z; \
    if (STORES(3u)) buffer[first + OFFSET_3] = normal.x; \
    if (STORES(4u)) buffer[first + OFFSET_4] = normal.y; \
    if (STORES(5u)) buffer[first + OFFSET_5] = normal.z; \
}

#if defined(POSES_BINDING) && defined(TEXELS)
#define NUMBERS_OF_WORD 1u
#define UNPACK(numbers, i, word) numbers[i] = NUMBER_OF(word);
#define PACK(numbers, i) WORD_OF(numbers[i])
#include "poses/texels.glsl"
#elif defined(POSES_BINDING)
layout(set = 0, binding = POSES_BINDING, std430) buffer Poses { NUMBER poses[]; };
#endif
