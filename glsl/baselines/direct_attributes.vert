// A draw of direct-attributes: the evaluation of attributes.glsl from the base pose, visible to the host. To capture
// its pose, feedback.vert or vertex_store.vert is run, which evaluates the same.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "attributes.glsl"

void main() {
    vec3 position, normal;
    evaluate(position, normal);
    gl_Position = vec4(position + normal, 1.0);
}
