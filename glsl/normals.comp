// Normals of the morphed surface, written into vertices of the application: for each vertex the sum of the area vectors
// of its triangles, as on import, with unit length. A lane processes a vertex, PIECE lanes a piece of the list. Float64:
// src/after/normals/mod.rs.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "abi.glsl"

#include "after.glsl"

// For each vertex: the base pose, six numbers; and from reads_at on the position of its fan. A fan: triangles, their
// common vertex, and for each triangle the other two, in order.
layout(set = 0, binding = 4, std430) readonly buffer Asset { uint asset[]; };

vec3 base_of(uint at) {
    return uintBitsToFloat(uvec3(asset[at], asset[at + 1u], asset[at + 2u]));
}

vec3 position_of(uint vertex) {
    vec3 position, normal;
    load(vertex, position, normal);
    return position;
}

void main() {
    uint vertex = vertex_of_lane();
    if (vertex >= vertices) {
        return;
    }
    uint fan = asset[reads_at + vertex];
    uint end = fan + 2u + 2u * asset[fan];
    vec3 from = position_of(asset[fan + 1u]);
    vec3 sum = vec3(0.0);
    for (uint at = fan + 2u; at < end; at += 2u) {
        sum += cross(position_of(asset[at]) - from, position_of(asset[at + 1u]) - from);
    }
    // Scaled first, since the squares of small areas would vanish in single precision.
    float most = max(max(abs(sum.x), abs(sum.y)), abs(sum.z));
    store_streams(vertex, vec3(0.0), most > 0.0 ? sum / most : base_of(6u * vertex + 3u));
}
