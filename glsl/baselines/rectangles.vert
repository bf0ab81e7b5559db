// A pass of texture (Galanakis, "Texture-based Blendshapes in DX9"): an instance is a rectangle of texels that a target
// moves, drawn as a strip of two triangles. texels.frag blends its deltas there.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "baselines/rectangles.glsl"

layout(set = 0, binding = 0, std430) readonly buffer Words { uint words[]; };

// First column and row, columns, and the texel of the delta textures that holds the first delta.
layout(location = 0) flat out uvec4 rectangle;

void main() {
    uint at = 5u * uint(gl_InstanceIndex);
    uvec2 first = uvec2(words[at], words[at + 1u]), size = uvec2(words[at + 2u], words[at + 3u]);
    rectangle = uvec4(first, size.x, words[at + 4u]);
    uvec2 corner = uvec2(gl_VertexIndex & 1, gl_VertexIndex >> 1);
    gl_Position = vec4(vec2(first + corner * size) * scale - 1.0, 0.0, 1.0);
}
