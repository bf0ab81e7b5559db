// fixed32: six integers, the displacement from the base pose in steps. CPU: src/pack/poses/fixed32.rs.

// All poses of a group of instances, where POSES_BINDING says and, with TEXELS, the binding after it; the number
// `at` of a pose is that of a component.
#define INTEGER_POSES
#define NUMBER int
#ifdef POSES_BINDING
#ifdef TEXELS
ALIASED layout(set = 0, binding = POSES_BINDING, std430) buffer Poses { uint64_t poses[]; };
ALIASED layout(set = 0, binding = POSES_BINDING + 1, rgba32ui) uniform uimageBuffer pose_texels;
#define LOAD_POSE(value, at) \
    [[unroll]] for (uint i = 0u; i < NUMBERS; i += 4u) { \
        ivec4 four = ivec4(imageLoad(pose_texels, int(((at) + i) / 4u))); \
        [[unroll]] for (uint j = 0u; j < 4u; ++j) value[i + j] = four[j]; \
    }
#define STORE_POSE_NUMBERS(at, value) \
    [[unroll]] for (uint i = 0u; i < NUMBERS; i += 2u) { \
        poses[((at) + i) / 2u] = packUint2x32(uvec2(value[i], value[i + 1u])); \
    }
#else
layout(set = 0, binding = POSES_BINDING, std430) buffer Poses { int poses[]; };
#define LOAD_POSE(value, at) [[unroll]] for (uint i = 0u; i < NUMBERS; ++i) value[i] = poses[(at) + i];
#define STORE_POSE_NUMBERS(at, value) [[unroll]] for (uint i = 0u; i < NUMBERS; ++i) poses[(at) + i] = value[i];
#endif
#endif
