// float32, dense: six floats. CPU: src/pack/formats/float32.rs.
// As a texture: texels of floats.
#define DELTA_TEXTURE texture2D

#ifdef DELTAS_BINDING
layout(set = 0, binding = DELTAS_BINDING, std430) readonly buffer Deltas { vec2 deltas[]; };

void add_delta(uint row, float coefficient, float normal_coefficient, inout vec3 position, inout vec3 normal) {
    vec2 a = deltas[3u * row], b = deltas[3u * row + 1u], c = deltas[3u * row + 2u];
    position += coefficient * vec3(a, b.x);
    normal += normal_coefficient * vec3(b.y, c);
}
#elif BATCH > 0
layout(location = 2) in vec3 deltas[2 * BATCH]; // position, normal, position, normal, …

layout(push_constant) uniform Push {
    float coefficients[BATCH];
};

#define ADD_ATTRIBUTES(i, position, normal) \
    position += coefficients[i] * deltas[2 * i]; \
    normal += coefficients[i] * deltas[2 * i + 1];
#endif
