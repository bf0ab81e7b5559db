// What the two kernels of the path `blocks` share: bindings, push constants, and coefficients.
// Work lists: src/update/blocks/{list,tiles}.rs. Entries: src/pack/blocks/mod.rs.

#extension GL_EXT_control_flow_attributes : require

// For software drivers, which pay for each access and lane, and for each subgroup of a workgroup: a lane has eight vertices
// (a block is one subgroup then), loads four words at once from texel buffers and stores two at once as a 64-bit integer.
#ifdef TEXELS
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#define VERTICES 8
#else
#define VERTICES 1
#endif

layout(local_size_x_id = 0) in;   // BLOCK_SIZE / VERTICES
layout(constant_id = 1) const uint BLOCK_SIZE = 64;

#ifdef TEXELS
#include "aliased.glsl"
layout(set = 0, binding = 0) uniform usamplerBuffer asset;
layout(set = 0, binding = 1) uniform usamplerBuffer work;
#else
layout(set = 0, binding = 0, std430) readonly buffer Asset { uint asset[]; };
layout(set = 0, binding = 1, std430) readonly buffer Work { uint work[]; };
#endif
// Poses: slots of the instances, source and destination alike. An invocation loads and stores its own vertices only, and
// loads before it stores.
#define POSES_BINDING 2
#include "pose.glsl"
#ifdef EXACT
#ifdef TEXELS
ALIASED layout(set = 0, binding = 4, std430) buffer Sums { uint64_t sums[]; };
ALIASED layout(set = 0, binding = 5, rgba32i) uniform iimageBuffer sum_texels;
#else
layout(set = 0, binding = 3, std430) buffer Sums { int sums[]; };
#endif
#define ADDEND ivec3
#else
#define ADDEND vec3
#endif

layout(push_constant) uniform Push {
    uint first_item;    // index of the first item's first word
    uint elements_at;   // index of the first element's first word (blocks.comp)
    uint deltas_at;     // index of the first delta word of the asset
    uint base_at;       // index of the base pose's first word
    uint pose_floats;   // floats of a pose
    uint slots;         // poses of an instance
    float position_unit; // exact: input units of a sum; float: of a step
    float normal_unit;
};

// The entries of the format: build.rs resolves `format.glsl` to the module's file under formats/. It defines DELTA, INTEGERS
// where deltas are integers in steps, and
//     load_entry(entry, lane, position, normal, shifts)
// what an entry adds to a lane's vertices at weight 1, in steps or input units, and by how many bits to shift both.
#include "format.glsl"

// A coefficient as the work list has it, in the unit of an entry.
#ifdef EXACT
#define COEFFICIENT(bits, unit, shift) (int(bits) << (shift))
#elif defined(INTEGERS)
// Unit and shift are powers of two: these products are exact.
#define COEFFICIENT(bits, unit, shift) (uintBitsToFloat(bits) * ((unit) * float(1u << (shift))))
#else
#define COEFFICIENT(bits, unit, shift) uintBitsToFloat(bits)
#endif
