// float32: the six numbers of a vertex, one after the other. CPU: src/pack/poses/float32.rs.

// Outputs of a vertex shader, as transform feedback captures them.
#define POSE_CAPTURE(position, normal) \
    layout(location = 0, xfb_buffer = 0, xfb_stride = 24, xfb_offset = 0) out vec3 position; \
    layout(location = 1, xfb_buffer = 0, xfb_offset = 12) out vec3 normal;

// Elements of a storage buffer that is loaded and stored vertex by vertex: three of a vertex.
#define POSE_ELEMENT vec2
// A vertex of `destination`: that of `source`, and what is added. One rounding at pose magnitude.
#define ADD_TO_POSE(destination, source, vertex, position, normal) \
    vec2 a = source[3u * vertex], b = source[3u * vertex + 1u], c = source[3u * vertex + 2u]; \
    destination[3u * vertex] = a + position.xy; \
    destination[3u * vertex + 1u] = b + vec2(position.z, normal.x); \
    destination[3u * vertex + 2u] = c + normal.yz;
#define STORE_POSE(destination, vertex, position, normal) \
    destination[3u * vertex] = position.xy; \
    destination[3u * vertex + 1u] = vec2(position.z, normal.x); \
    destination[3u * vertex + 2u] = normal.yz;

// All poses of a group of instances, where POSES_BINDING says and, with TEXELS, the binding after it; the number
// `at` of a pose is that of a component.
#define NUMBER float
#ifdef POSES_BINDING
#ifdef TEXELS
// What is loaded as texels is stored as integers.
ALIASED layout(set = 0, binding = POSES_BINDING, std430) buffer Poses { uint64_t poses[]; };
ALIASED layout(set = 0, binding = POSES_BINDING + 1, rgba32ui) uniform uimageBuffer pose_texels;
#define LOAD_POSE(head, at) \
    NUMBER value[NUMBERS]; \
    [[unroll]] for (uint i = 0u; i < NUMBERS; i += 4u) { \
        vec4 four = uintBitsToFloat(imageLoad(pose_texels, int(((at) + i) / 4u))); \
        [[unroll]] for (uint j = 0u; j < 4u; ++j) value[i + j] = four[j]; \
    } \
    FROM_NUMBERS(head, value)
#define STORE_POSE_NUMBERS(at, head) \
    NUMBER value[NUMBERS]; \
    TO_NUMBERS(value, head) \
    [[unroll]] for (uint i = 0u; i < NUMBERS; i += 2u) { \
        poses[((at) + i) / 2u] = packUint2x32(floatBitsToUint(vec2(value[i], value[i + 1u]))); \
    }
#else
layout(set = 0, binding = POSES_BINDING, std430) buffer Poses { float poses[]; };
#define LOAD_POSE(head, at) \
    head.position = ADDEND(poses[at], poses[(at) + 1u], poses[(at) + 2u]); \
    head.normal = ADDEND(poses[(at) + 3u], poses[(at) + 4u], poses[(at) + 5u]);
#define STORE_POSE_NUMBERS(at, head) \
    poses[at] = head.position.x; \
    poses[(at) + 1u] = head.position.y; \
    poses[(at) + 2u] = head.position.z; \
    poses[(at) + 3u] = head.normal.x; \
    poses[(at) + 4u] = head.normal.y; \
    poses[(at) + 5u] = head.normal.z;
#endif
#define LOAD_COMPONENT(at) poses[at]
#define STORE_COMPONENT(at, value) poses[at] = value
#endif
