// fixed16: six integers of 16 bits, the displacement from the base pose in steps, two to a word, the first in the lower
// half. CPU: src/pack/poses/fixed16.rs.

// All poses of a group of instances, where POSES_BINDING says and, with TEXELS, the binding after it; the number
// `at` of a pose is that of a component.
#define INTEGER_POSES
// Coefficients are pairs: what a target adds is rounded, as a function of its weight.
#define ROUNDED_PRODUCTS
#define NUMBER int
#define ADDEND ivec3
#define LOW(word) bitfieldExtract(int(word), 0, 16)
#define HIGH(word) (int(word) >> 16)
#define WORD(low, high) (uint(low) & 0xffffu | uint(high) << 16)

// Elements of a storage buffer that is loaded and stored vertex by vertex: three of a vertex. Sums wrap.
#define POSE_ELEMENT uint
#define ADD_POSE(source, vertex, position, normal) \
    uint a = source[3u * vertex], b = source[3u * vertex + 1u], c = source[3u * vertex + 2u]; \
    position += ivec3(LOW(a), HIGH(a), LOW(b)); \
    normal += ivec3(HIGH(b), LOW(c), HIGH(c));
#define STORE_POSE(destination, vertex, position, normal) \
    destination[3u * vertex] = WORD(position.x, position.y); \
    destination[3u * vertex + 1u] = WORD(position.z, normal.x); \
    destination[3u * vertex + 2u] = WORD(normal.y, normal.z);

#ifdef POSES_BINDING
#ifdef TEXELS
ALIASED layout(set = 0, binding = POSES_BINDING, std430) buffer Poses { uint64_t poses[]; };
ALIASED layout(set = 0, binding = POSES_BINDING + 1, rgba32ui) uniform uimageBuffer pose_texels;

void load_vertices(uint at, out int numbers[NUMBERS]) {
    [[unroll]] for (uint i = 0u; i < NUMBERS; i += 8u) {
        uvec4 eight = imageLoad(pose_texels, int((at + i) / 8u));
        [[unroll]] for (uint j = 0u; j < 4u; ++j) {
            numbers[i + 2u * j] = LOW(eight[j]);
            numbers[i + 2u * j + 1u] = HIGH(eight[j]);
        }
    }
}

void store_vertices(uint at, int numbers[NUMBERS]) {
    [[unroll]] for (uint i = 0u; i < NUMBERS; i += 4u) {
        uvec2 four = uvec2(WORD(numbers[i], numbers[i + 1u]), WORD(numbers[i + 2u], numbers[i + 3u]));
        poses[(at + i) / 4u] = packUint2x32(four);
    }
}
#else
layout(set = 0, binding = POSES_BINDING, std430) buffer Poses { uint poses[]; };

void load_vertex(uint at, out ivec3 position, out ivec3 normal) {
    uint first = at / 2u;
    uint a = poses[first], b = poses[first + 1u], c = poses[first + 2u];
    position = ivec3(LOW(a), HIGH(a), LOW(b));
    normal = ivec3(HIGH(b), LOW(c), HIGH(c));
}

void store_vertex(uint at, ivec3 position, ivec3 normal) {
    uint first = at / 2u;
    poses[first] = WORD(position.x, position.y);
    poses[first + 1u] = WORD(position.z, normal.x);
    poses[first + 2u] = WORD(normal.y, normal.z);
}
#endif
#endif
