#version 450
// A vertex of a pose in float32.
#extension GL_GOOGLE_include_directive : require
#define POSE_FLOAT32
#include "../../glsl/host/pose.glsl"

layout(push_constant) uniform Push { mat4 view; };
layout(location = 0) out vec3 normal;

void main() {
    gl_Position = view * vec4(pose_position(), 1.0);
    normal = pose_normal();
}
