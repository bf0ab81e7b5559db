// fixed16: six integers of 16 bits in units, two to a word, the first in the lower half.
// CPU: src/pack/poses/fixed16.rs.

#include "poses/integers.glsl"
// Coefficients are pairs: the amount that a target adds is rounded, as a function of its weight.
#define ROUNDED_PRODUCTS
#define POSE_ELEMENT uint
#define NUMBER_OF(word) int(word)
#define LOW(word) bitfieldExtract(int(word), 0, 16)
#define HIGH(word) (int(word) >> 16)
#define WORD(low, high) (uint(low) & 0xffffu | uint(high) << 16)

// A vertex in a storage buffer of words, beginning at number `at`.
#define LOAD_VERTEX(buffer, at, position, normal) LOAD_WORDS_OF(buffer, (at) / 2u, position, normal)
#define LOAD_WORDS_OF(buffer, word, position, normal) { \
    uint first = word; \
    uint a = buffer[first], b = buffer[first + 1u], c = buffer[first + 2u]; \
    position = ivec3(LOW(a), HIGH(a), LOW(b)); \
    normal = ivec3(HIGH(b), LOW(c), HIGH(c)); \
}
#define STORE_VERTEX(buffer, at, position, normal) { \
    uint first = (at) / 2u; \
    buffer[first] = WORD(position.x, position.y); \
    buffer[first + 1u] = WORD(position.z, normal.x); \
    buffer[first + 2u] = WORD(normal.y, normal.z); \
}

#if defined(POSES_BINDING) && defined(TEXELS)
#define NUMBERS_OF_WORD 2u
#define UNPACK(numbers, i, word) { numbers[i] = LOW(word); numbers[(i) + 1u] = HIGH(word); }
#define PACK(numbers, i) WORD(numbers[i], numbers[(i) + 1u])
#include "poses/texels.glsl"
#elif defined(POSES_BINDING)
layout(set = 0, binding = POSES_BINDING, std430) buffer Poses { uint poses[]; };
#endif
