// What the two kernels of the path `blocks` share: bindings, push constants, and coefficients.
// Work lists: src/plan/blocks/{list,tiles}.rs. Entries: src/mesh/packed/blocks/mod.rs.

#extension GL_EXT_control_flow_attributes : require

// For software drivers, a lane has eight vertices, and loads and stores four words at once: they pay for each word and
// lane (Mesa 22.3.6 with a bounds check each), and for each subgroup of a workgroup, of which a block has one then.
#ifdef TEXELS
#define VERTICES 8
#else
#define VERTICES 1
#endif

layout(local_size_x_id = 0) in;   // BLOCK_SIZE / VERTICES
layout(constant_id = 1) const uint BLOCK_SIZE = 64;

layout(set = 0, binding = 0, std430) readonly buffer Asset { uint asset[]; };
layout(set = 0, binding = 1, std430) readonly buffer Work { uint work[]; };
// Poses: slots of the instances, source and destination alike. An invocation loads and stores its own vertices only.
#ifdef TEXELS
layout(set = 0, binding = 2, rgba32f) uniform imageBuffer poses;
// The asset again, four words a texel and one.
layout(set = 0, binding = 3) uniform usamplerBuffer texels;
layout(set = 0, binding = 4) uniform usamplerBuffer words;
#ifdef EXACT
layout(set = 0, binding = 5, rgba32i) uniform iimageBuffer sums;
#endif
#else
layout(set = 0, binding = 2, std430) buffer Poses { float poses[]; };
#ifdef EXACT
layout(set = 0, binding = 3, std430) buffer Sums { int sums[]; };
#endif
#endif
#ifdef EXACT
#define ADDEND ivec3
#else
#define ADDEND vec3
#endif

layout(push_constant) uniform Push {
    uint first_item;    // index of the first item's first word
    uint elements_at;   // index of the first element's first word
    uint deltas_at;     // index of the first delta word of the asset
    uint base_at;       // index of the base pose's first word
    uint pose_floats;   // floats of a pose
    uint slots;         // poses of an instance
    float position_unit; // exact: input units of a sum; float: of a step
    float normal_unit;
};

#include "entry.glsl"

// A coefficient as the work list has it, in the unit of an entry.
#ifdef EXACT
#define COEFFICIENT(bits, unit, shift) (int(bits) << (shift))
#elif defined(FAST) || defined(SMALL)
// Unit and shift are powers of two: these products are exact.
#define COEFFICIENT(bits, unit, shift) (uintBitsToFloat(bits) * ((unit) * float(1u << (shift))))
#else
#define COEFFICIENT(bits, unit, shift) uintBitsToFloat(bits)
#endif
