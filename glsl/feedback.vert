// A feedback pass: captures the evaluation of attributes.glsl.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "attributes.glsl"

POSE_CAPTURE(pose_position, pose_normal)

void main() {
    evaluate(pose_position, pose_normal);
}
