// Shared by the kernels of the path `blocks`: bindings, push constants, and coefficients. Work lists:
// src/abi/worklist.rs. Entries: src/pack/blocks/mod.rs.

#extension GL_EXT_control_flow_attributes : require

layout(local_size_x_id = 0) in;   // BLOCK_SIZE / VERTICES
layout(constant_id = 1) const uint BLOCK_SIZE = 64;

// Vertices per lane.
#ifdef TEXELS
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
const uint VERTICES = BLOCK_SIZE / 8u - BLOCK_SIZE / 128u * 8u; // 4 of 32, 8 of 64 and 128
#else
#define VERTICES 1
#endif
const uint NUMBERS = 6u * VERTICES;

#ifdef TEXELS
#include "aliased.glsl"
layout(set = 0, binding = 0) uniform usamplerBuffer asset;
layout(set = 0, binding = 1) uniform usamplerBuffer work;
layout(set = 0, binding = 4) uniform usamplerBuffer base;
#else
layout(set = 0, binding = 0, std430) readonly buffer Asset { uint asset[]; };
layout(set = 0, binding = 1, std430) readonly buffer Work { uint work[]; };
layout(set = 0, binding = 3, std430) readonly buffer Base { uint base[]; };
#endif
// Poses: slots of the instances, both source and destination. An invocation loads and stores only its own vertices, and
// loads before it stores.
#define POSES_BINDING 2
#include "pose.glsl"

layout(push_constant) uniform Push {
    uint first_item;    // index of the first item's first word
    uint deltas_at;     // index of the asset's first delta word; headers begin at 0
    uint base_at;       // index of the base pose's first number in its buffer
    uint pose_floats;   // numbers from pose to pose
    float position_unit; // of an integer delta, for float32 sums
    float normal_unit;
    uvec2 raised;       // ROUNDED_PRODUCTS: left shift of products to 2^-16 of units, of positions and of normals
};

#ifdef TEXELS
// Read once: software drivers load push constants lane by lane, in a loop again and again.
uint deltas_once = deltas_at;
vec2 units_once = vec2(position_unit, normal_unit);
uvec2 raised_once = raised;
#define deltas_at deltas_once
#define raised raised_once
#define position_unit units_once.x
#define normal_unit units_once.y
#endif

// The entries of the format: build.rs resolves `format.glsl` to the module's file under formats/. It defines
//     load_entry(entry, lane, position, normal, shifts)
// which returns what an entry adds to a lane's vertices at weight 1, in steps, and the number of bits by which to shift
// both. With TEXELS it may define PARTS instead, and
//     load_part(entry, lane, part, position, normal, shifts)
// which returns the components of one part of the entry, and zeros; the first part is 0. `part` becomes the next one,
// or 0 behind the last.
#include "format.glsl"

// The factors of an entry, from the coefficient in the work list, and their product with a delta.
#ifdef ROUNDED_PRODUCTS
#include "rounded.glsl"
#define RAISE(shifts) shifts += raised;
#define FACTOR ivec2
// The weight that the pose will hold, of 16 bits, or of 32 where sums are rounded; and the one that it holds.
#define FACTOR_OF(bits, unit, shift) \
    (ivec2(bitfieldExtract(int(bits), 0, 32 - int(PRODUCT_BITS)), int(bits) >> 16) << (shift))
// Sums that start from the base pose, and those that are rounded, replace no weight: one product is enough. crowd.comp
// subtracts the other one itself.
#ifdef TEXELS
#define ONE_PRODUCT (REBUILT_ITEMS != 0u)
#else
#define ONE_PRODUCT true
#endif
#define PRODUCT(factor, delta) ((factor) * (delta) + PRODUCT_HALF >> PRODUCT_BITS)
#define TIMES(factor, delta) \
    (PRODUCT((factor).x, delta) - (ONE_PRODUCT ? ivec3(0) : PRODUCT((factor).y, delta)))
#else
#define RAISE(shifts)
#define FACTOR ADDEND
#ifdef INTEGER_POSES
#define FACTOR_OF(bits, unit, shift) ADDEND(int(bits) << (shift))
#else
// Unit and shift are powers of two: these products are exact.
#define FACTOR_OF(bits, unit, shift) ADDEND(uintBitsToFloat(bits) * ((unit) * float(1u << (shift))))
#endif
#define TIMES(factor, delta) ((factor) * ADDEND(delta))
#endif
