#version 450
// A matt surface, lit from one side.
layout(location = 0) in vec3 normal;
layout(location = 0) out vec4 pixel;

void main() {
    float light = 0.5 + 0.5 * dot(normalize(normal), vec3(0.36, 0.48, 0.8));
    pixel = vec4(light * vec3(0.9, 0.7, 0.6), 1.0);
}
