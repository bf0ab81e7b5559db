// Writes streams of a pose into vertices of the application. With SKIN positions and normals are skinned by joints, with
// DUAL by dual quaternions. CPU twin: PoseFormat::decode. Float64: src/after/skin/reference.rs.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "abi.glsl"

#include "after.glsl"

#ifdef SKIN
layout(constant_id = 5) const uint INFLUENCES = 4u;

// For each vertex its joints, two to a word, and their weights, the largest first.
layout(set = 0, binding = 4, std430) readonly buffer Influences { uint influences[]; };
// A matrix has three rows, a dual quaternion a real and a dual part: (x, y, z, w). The first is reads_at.
layout(set = 0, binding = 5, std430) readonly buffer Joints { vec4 joints[]; };
#ifdef DUAL
const uint JOINT = 2u;
#else
const uint JOINT = 3u;
#endif

// Returns the index of the first vector of an influence's joint.
uint joint_at(uint skin, uint i) {
    return reads_at + JOINT * bitfieldExtract(influences[skin + i / 2u], int(i % 2u) * 16, 16);
}

float weight_of(uint skin, uint i) {
    return uintBitsToFloat(influences[skin + INFLUENCES / 2u + i]);
}

void load_skinned(uint vertex, out vec3 position, out vec3 normal) {
    uint skin = (INFLUENCES + INFLUENCES / 2u) * vertex;
#ifdef DUAL
    // Kavan et al., "Geometric Skinning with Approximate Dual Quaternion Blending" (2008), algorithm 1. A quaternion
    // and its negative are the same rotation: all are taken on the side of the first, which has the largest weight.
    uint first = joint_at(skin, 0u);
    vec4 pivot = joints[first];
    vec4 real = weight_of(skin, 0u) * pivot;
    vec4 dual = weight_of(skin, 0u) * joints[first + 1u];
    [[dont_unroll]] for (uint i = 1u; i < INFLUENCES; ++i) {
        float weight = weight_of(skin, i);
        if (weight == 0.0) {
            break;
        }
        uint joint = joint_at(skin, i);
        vec4 rotation = joints[joint];
        weight = dot(rotation, pivot) < 0.0 ? -weight : weight;
        real += weight * rotation;
        dual += weight * joints[joint + 1u];
    }
    float scale = inversesqrt(dot(real, real));
    real *= scale;
    dual *= scale;
#else
    vec4 x = vec4(0.0), y = vec4(0.0), z = vec4(0.0);
    // Not unrolled: compilers would load all joints first, and have fewer lanes in flight for the registers that takes.
    [[dont_unroll]] for (uint i = 0u; i < INFLUENCES; ++i) {
        float weight = weight_of(skin, i);
        if (weight == 0.0) {
            break;
        }
        uint joint = joint_at(skin, i);
        x += weight * joints[joint];
        y += weight * joints[joint + 1u];
        z += weight * joints[joint + 2u];
    }
#endif
    // Loaded after the loop, which needs the registers.
    load(vertex, position, normal);
#ifdef DUAL
    position += 2.0 * cross(real.xyz, cross(real.xyz, position) + real.w * position);
    position += 2.0 * (real.w * dual.xyz - dual.w * real.xyz + cross(real.xyz, dual.xyz));
    normal += 2.0 * cross(real.xyz, cross(real.xyz, normal) + real.w * normal);
#else
    vec4 from = vec4(position, 1.0);
    position = vec3(dot(x, from), dot(y, from), dot(z, from));
    // The inverse transpose, times the determinant, whose sign is negative for a mirrored joint.
    vec3 yz = cross(y.xyz, z.xyz);
    float mirrored = dot(x.xyz, yz) < 0.0 ? -1.0 : 1.0;
    normal = mirrored * vec3(dot(yz, normal), dot(cross(z.xyz, x.xyz), normal), dot(cross(x.xyz, y.xyz), normal));
#endif
}
#endif

void main() {
    uint vertex = vertex_of_lane();
    if (vertex >= vertices) {
        return;
    }
    vec3 position, normal;
#ifdef SKIN
    load_skinned(vertex, position, normal);
#else
    load(vertex, position, normal);
#endif
    store_streams(vertex, position, normal);
}
