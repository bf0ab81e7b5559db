// A draw of texture: base pose + the displacement at the vertex's texel.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_samplerless_texture_functions : require
#include "pose.glsl"

layout(location = 0) in vec3 base_position;
layout(location = 1) in vec3 base_normal;

layout(set = 0, binding = 0, std430) readonly buffer Words { uint words[]; };
// Layer 0: positions, layer 1: normals.
layout(set = 0, binding = 2) uniform texture2DArray displacements;

layout(push_constant) uniform Push {
    uint texels_at;   // where the texels of vertices begin, in words
    uint row;         // texels of a row of the displacement textures
};

#if defined(FEEDBACK)
POSE_CAPTURE(pose_position, pose_normal)
#elif defined(STORE)
#define POSE_BINDING 1
#include "baselines/store.glsl"
#endif

void main() {
    uint texel = words[texels_at + uint(gl_VertexIndex)];
    ivec2 at = ivec2(texel % row, texel / row);
    vec3 position = base_position + texelFetch(displacements, ivec3(at, 0), 0).xyz;
    vec3 normal = base_normal + texelFetch(displacements, ivec3(at, 1), 0).xyz;
#if defined(FEEDBACK)
    pose_position = position;
    pose_normal = normal;
#elif defined(STORE)
    store_pose(uint(gl_VertexIndex), position, normal);
#else
    gl_Position = vec4(position + normal, 1.0);
#endif
}
