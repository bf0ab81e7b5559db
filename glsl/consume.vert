// A draw that only reads a pose, as the host's would (rasterizer discard): what `draw_ms` measures.
#version 450

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;

void main() {
    gl_Position = vec4(position + normal, 1.0);
}
