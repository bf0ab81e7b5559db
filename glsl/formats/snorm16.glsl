// snorm16, dense: two signed 16-bit integers to a word, in steps. CPU: src/pack/formats/snorm16.rs.
// As a texture: texels of integers.
#define DELTA_TEXTURE itexture2D

void decode_snorm16(uvec3 words, out ivec3 position, out ivec3 normal) {
    ivec3 low = bitfieldExtract(ivec3(words), 0, 16);
    ivec3 high = bitfieldExtract(ivec3(words), 16, 16);
    position = ivec3(low.x, high.x, low.y);
    normal = ivec3(high.y, low.z, high.z);
}

#ifdef DELTAS_BINDING
layout(set = 0, binding = DELTAS_BINDING, std430) readonly buffer Deltas { uint deltas[]; };

void add_delta(uint row, float coefficient, float normal_coefficient, inout vec3 position, inout vec3 normal) {
    ivec3 p, n;
    decode_snorm16(uvec3(deltas[3u * row], deltas[3u * row + 1u], deltas[3u * row + 2u]), p, n);
    position += coefficient * vec3(p);
    normal += normal_coefficient * vec3(n);
}
#elif BATCH > 0
layout(location = 2) in uvec3 deltas[BATCH];

layout(push_constant) uniform Push {
    float coefficients[BATCH];
    uint normal_exponents[(BATCH + 3) / 4];
};

#define ADD_ATTRIBUTES(i, position, normal) \
    ivec3 delta_position, delta_normal; \
    decode_snorm16(deltas[i], delta_position, delta_normal); \
    position += coefficients[i] * vec3(delta_position); \
    normal += coefficients[i] * normal_ratio(normal_exponents[i >> 2], i) * vec3(delta_normal);
#endif
