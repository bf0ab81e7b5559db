// A vertex has six words, one for each number. The including format defines
//     NUMBER, ADDEND             a number, and three
//     NUMBER_OF(word)            the number that has these bits, and the reverse
//     WORD_OF(number)

// A vertex in a storage buffer of numbers, beginning at number `at`.
#define LOAD_VERTEX(buffer, at, position, normal) { \
    uint first = at; \
    position = ADDEND(buffer[first], buffer[first + 1u], buffer[first + 2u]); \
    normal = ADDEND(buffer[first + 3u], buffer[first + 4u], buffer[first + 5u]); \
}
#define STORE_VERTEX(buffer, at, position, normal) { \
    uint first = at; \
    buffer[first] = position.x; \
    buffer[first + 1u] = position.y; \
    buffer[first + 2u] = position.z; \
    buffer[first + 3u] = normal.x; \
    buffer[first + 4u] = normal.y; \
    buffer[first + 5u] = normal.z; \
}

#if defined(POSES_BINDING) && defined(TEXELS)
#define NUMBERS_OF_WORD 1u
#define UNPACK(numbers, i, word) numbers[i] = NUMBER_OF(word);
#define PACK(numbers, i) WORD_OF(numbers[i])
#include "poses/texels.glsl"
#elif defined(POSES_BINDING)
layout(set = 0, binding = POSES_BINDING, std430) buffer Poses { NUMBER poses[]; };
#endif
