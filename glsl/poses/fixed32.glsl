// fixed32: six integers, the displacement from the base pose in steps. CPU: src/pack/poses/fixed32.rs.

// All poses of a group of instances, where POSES_BINDING says and, with TEXELS, the binding after it; the number
// `at` of a pose is that of a component.
#define INTEGER_POSES
#define NUMBER int
#ifdef POSES_BINDING
#ifdef TEXELS
ALIASED layout(set = 0, binding = POSES_BINDING, std430) buffer Poses { uint64_t poses[]; };
ALIASED layout(set = 0, binding = POSES_BINDING + 1, rgba32ui) uniform uimageBuffer pose_texels;
#define LOAD_POSE(head, at) \
    NUMBER value[NUMBERS]; \
    [[unroll]] for (uint i = 0u; i < NUMBERS; i += 4u) { \
        ivec4 four = ivec4(imageLoad(pose_texels, int(((at) + i) / 4u))); \
        [[unroll]] for (uint j = 0u; j < 4u; ++j) value[i + j] = four[j]; \
    } \
    FROM_NUMBERS(head, value)
#define STORE_POSE_NUMBERS(at, head) \
    NUMBER value[NUMBERS]; \
    TO_NUMBERS(value, head) \
    [[unroll]] for (uint i = 0u; i < NUMBERS; i += 2u) { \
        poses[((at) + i) / 2u] = packUint2x32(uvec2(value[i], value[i + 1u])); \
    }
#else
layout(set = 0, binding = POSES_BINDING, std430) buffer Poses { int poses[]; };
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
#endif
