// A draw that only reads a pose, as a draw of the host would (with rasterizer discard): measured as `draw_ms`.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "host/pose.glsl"

void main() {
    gl_Position = vec4(pose_position() + pose_normal(), 1.0);
}
