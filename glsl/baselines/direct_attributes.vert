// A draw of direct-attributes: what attributes.glsl evaluates, from the base pose, for the host to see. Its pose is
// captured by running feedback.vert or vertex_store.vert, which evaluate the same.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "attributes.glsl"

void main() {
    vec3 position, normal;
    evaluate(position, normal);
    gl_Position = vec4(position + normal, 1.0);
}
