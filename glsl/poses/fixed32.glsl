// fixed32: six integers, the displacement from the base pose in steps. CPU: src/pack/poses/fixed32.rs.

// All poses of a group of instances, where POSES_BINDING says and, with TEXELS, the binding after it; the number
// `at` of a pose is that of a component.
#define INTEGER_POSES
#define NUMBER int
#define ADDEND ivec3

// Elements of a storage buffer that is loaded and stored vertex by vertex: six of a vertex. Sums wrap.
#define POSE_ELEMENT int
#define ADD_POSE(source, vertex, position, normal) \
    uint at = 6u * vertex; \
    position += ivec3(source[at], source[at + 1u], source[at + 2u]); \
    normal += ivec3(source[at + 3u], source[at + 4u], source[at + 5u]);
#define STORE_POSE(destination, vertex, position, normal) \
    uint at = 6u * vertex; \
    destination[at] = position.x; \
    destination[at + 1u] = position.y; \
    destination[at + 2u] = position.z; \
    destination[at + 3u] = normal.x; \
    destination[at + 4u] = normal.y; \
    destination[at + 5u] = normal.z;
#ifdef POSES_BINDING
#define NUMBER_OF(word) int(word)
#define WORD_OF(number) uint(number)
#include "poses/six_words.glsl"
#endif
