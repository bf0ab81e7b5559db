// A texel of a rectangle that a target moves: weight · delta, added to the textures by blending.
#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_samplerless_texture_functions : require
#include "format.glsl"
#include "baselines/rectangles.glsl"

layout(set = 0, binding = 1) uniform DELTA_TEXTURE positions;
layout(set = 0, binding = 2) uniform DELTA_TEXTURE normals;

layout(location = 0) flat in uvec4 rectangle;

layout(location = 0) out vec4 position;
layout(location = 1) out vec4 normal;

void main() {
    uvec2 texel = uvec2(gl_FragCoord.xy) - rectangle.xy;
    uint delta = rectangle.w + texel.y * rectangle.z + texel.x;
    ivec2 at = ivec2(delta % row, delta / row);
    position = vec4(coefficients.x * vec3(texelFetch(positions, at, 0).xyz), 0.0);
    normal = vec4(coefficients.y * vec3(texelFetch(normals, at, 0).xyz), 0.0);
}
