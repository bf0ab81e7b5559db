#version 450
// A vertex of a pose, as pose.glsl finds it in the crowd's own buffer.
#extension GL_GOOGLE_include_directive : require
#define POSE_LOCATION 2
#ifdef MOTION
#define POSE_PREVIOUS
#endif
#include "pose.glsl"
#include "scene.glsl"

layout(location = 0) in vec3 rest_position;
layout(location = 1) in vec3 rest_normal;
#ifdef MASKS
// The wrinkle masks of the pose, a stream of the mesh.
#ifdef POSE_FLOAT32
layout(location = 6) in vec2 masks;
#else
layout(location = 6) in ivec2 masks;
#endif
#endif

layout(location = 0) out vec3 position;
layout(location = 1) out vec3 normal;
layout(location = 2) out vec3 rest;
layout(location = 3) out vec3 shown; // a number of the block or wrinkle masks, and a value from 0 to 1

void main() {
    position = offset.xyz + scale.xyz * pose_position();
    gl_Position = clip * vec4(position, 1.0);
    // Normals are sums. A sum of nearly nothing has no direction: that of the base pose is taken.
    vec3 sum = scale.w * pose_normal();
    float length_squared = dot(sum, sum);
    normal = length_squared < 1e-6 ? rest_normal : sum * inversesqrt(length_squared);
    rest = rest_position;
    float measured = distance(position, rest_position);
    vec2 where = vec2(0.0);
    if (show.x == SHOW_BLOCKS) {
        measured = first_told == NONE_TOLD ? 0.0 : told[first_told + uint(gl_VertexIndex) / PIECE];
        // A number for each block, 0 to 1, unlike that of its neighbours.
        where.x = fract(float(uint(gl_VertexIndex) / block) * 0.618034);
    }
#ifdef MASKS
    where = mask_scale.zw + mask_scale.xy * vec2(masks);
#endif
#ifdef MOTION
    measured = distance(position, offset.xyz + scale.xyz * previous_position());
#endif
    shown = vec3(where, measured / show.y);
    // Edges lie in front of the faces that they belong to.
    if (material == WIRE) gl_Position.z -= 3e-4 * gl_Position.w;
}
