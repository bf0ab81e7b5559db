// Deltas of a dense format in a storage buffer.

#ifdef SNORM16
layout(set = 0, binding = DELTAS_BINDING, std430) readonly buffer Deltas { uint deltas[]; };
#else
layout(set = 0, binding = DELTAS_BINDING, std430) readonly buffer Deltas { vec2 deltas[]; };
#endif

// Add coefficient · delta of one target, `row` being the index of the vertex in the chunk's deltas.
void add_delta(uint row, float coefficient, float normal_coefficient, inout vec3 position, inout vec3 normal) {
#ifdef SNORM16
    vec3 p, n;
    decode_snorm16(uvec3(deltas[3u * row], deltas[3u * row + 1u], deltas[3u * row + 2u]), p, n);
    position += coefficient * p;
    normal += normal_coefficient * n;
#else
    vec2 a = deltas[3u * row], b = deltas[3u * row + 1u], c = deltas[3u * row + 2u];
    position += coefficient * vec3(a, b.x);
    normal += normal_coefficient * vec3(b.y, c);
#endif
}
