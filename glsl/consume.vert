// A draw that only reads a pose, as the host's would (rasterizer discard): what `draw_ms` measures.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "pose.glsl"

POSE_ATTRIBUTES(position, normal)

void main() {
    gl_Position = vec4(position + normal, 1.0);
}
