#version 450
// A vertex of a pose as the key light sees it.
#extension GL_GOOGLE_include_directive : require
#define POSE_LOCATION 2
#include "pose.glsl"
#include "scene.glsl"

void main() {
    vec4 place = shadow * vec4(offset.xyz + scale.xyz * pose_position(), 1.0);
    gl_Position = vec4(place.xy * 2.0 - 1.0, place.z, 1.0);
}
