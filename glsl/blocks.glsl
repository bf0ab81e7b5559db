// What the kernels of the path `blocks` share: bindings, push constants, and coefficients.
// Work lists: src/abi/worklist.rs. Entries: src/pack/blocks/mod.rs.

#extension GL_EXT_control_flow_attributes : require

// Vertices of a lane.
#ifdef TEXELS
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#define VERTICES 8
#else
#define VERTICES 1
#endif
const uint NUMBERS = 6u * VERTICES;

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

layout(push_constant) uniform Push {
    uint first_item;    // index of the first item's first word
    uint elements_at;   // index of the first element's first word (blocks.comp)
    // Where headers, deltas and base pose would begin in the asset if the part that is bound had those of all blocks.
    uint headers_at;
    uint deltas_at;
    uint base_at;
    uint pose_floats;   // numbers from pose to pose
    float position_unit; // of an integer delta, for float32 sums
    float normal_unit;
    uint position_dropped; // lowest bits of products that rounding drops (ROUNDED_PRODUCTS)
    uint normal_dropped;
};

// The entries of the format: build.rs resolves `format.glsl` to the module's file under formats/. It defines DELTA, INTEGERS
// where deltas are integers in steps, and
//     load_entry(entry, lane, position, normal, shifts)
// what an entry adds to a lane's vertices at weight 1, in steps or input units, and by how many bits to shift both.
#include "format.glsl"

// What an entry is multiplied by, from the coefficient in the work list; and the product with a delta.
#ifdef ROUNDED_PRODUCTS
#include "rounded.glsl"
#define FACTOR ivec2
#define FACTOR_OF(bits, unit, shift) (two_weights(bits) << (shift))
// What starts from the base pose holds no weight: one product is enough.
#define TIMES(factor, delta, dropped) \
    (REBUILT_ITEMS ? rounded_term((factor).x, delta, dropped) : rounded_product(factor, delta, dropped))
#else
#define FACTOR ADDEND
#ifdef INTEGER_POSES
#define FACTOR_OF(bits, unit, shift) ADDEND(int(bits) << (shift))
#elif defined(INTEGERS)
// Unit and shift are powers of two: these products are exact.
#define FACTOR_OF(bits, unit, shift) ADDEND(uintBitsToFloat(bits) * ((unit) * float(1u << (shift))))
#else
#define FACTOR_OF(bits, unit, shift) ADDEND(uintBitsToFloat(bits))
#endif
#define TIMES(factor, delta, dropped) ((factor) * ADDEND(delta))
#endif
