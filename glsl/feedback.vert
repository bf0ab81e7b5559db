// A feedback pass: what attributes.glsl evaluates, captured.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "attributes.glsl"

layout(location = 0, xfb_buffer = 0, xfb_stride = 24, xfb_offset = 0) out vec3 pose_position;
layout(location = 1, xfb_buffer = 0, xfb_offset = 12) out vec3 pose_normal;

void main() {
    evaluate(pose_position, pose_normal);
}
