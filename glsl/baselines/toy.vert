// A pass of the toy: the evaluation of attributes.glsl, stored by the shader.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "attributes.glsl"
#include "baselines/store.glsl"

void main() {
    vec3 position, normal;
    evaluate(position, normal);
    store_pose(uint(gl_VertexIndex), position, normal);
}
