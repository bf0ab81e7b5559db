// A draw that only reads the positions of a pose, as passes for depth and shadows do (with rasterizer discard).
#version 450

#if defined(POSE_FLOAT32)
layout(location = 0) in vec3 position;
#else
layout(location = 0) in ivec3 position;
#endif

void main() {
    gl_Position = vec4(position, 1.0);
}
