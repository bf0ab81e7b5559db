// float32: the six numbers of a vertex, one after the other. CPU: src/pack/poses/float32.rs.

// Outputs of a vertex shader, as transform feedback captures them.
#define POSE_CAPTURE(position, normal) \
    layout(location = 0, xfb_buffer = 0, xfb_stride = 24, xfb_offset = 0) out vec3 position; \
    layout(location = 1, xfb_buffer = 0, xfb_offset = 12) out vec3 normal;

// Elements of a storage buffer that is loaded and stored by vertices: three for each vertex.
#define POSE_ELEMENT vec2
// Adds a vertex of `source`. One rounding at the magnitude of the pose.
#define ADD_POSE(source, vertex, position, normal) \
    vec2 a = source[3u * vertex], b = source[3u * vertex + 1u], c = source[3u * vertex + 2u]; \
    position += vec3(a, b.x); \
    normal += vec3(b.y, c);
#define STORE_POSE(destination, vertex, position, normal) \
    destination[3u * vertex] = position.xy; \
    destination[3u * vertex + 1u] = vec2(position.z, normal.x); \
    destination[3u * vertex + 2u] = normal.yz;

#define NUMBER float
#define ADDEND vec3
#define NUMBER_OF(word) uintBitsToFloat(word)
#define WORD_OF(number) floatBitsToUint(number)
#include "poses/six_words.glsl"
