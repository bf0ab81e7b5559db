// A vertex stage over BATCH targets bound as vertex attributes: source + Σ coefficient · delta. CPU twin:
// cpu::kernel::dense.
#include "delta.glsl"

layout(location = 0) in vec3 source_position;
layout(location = 1) in vec3 source_normal;

#if BATCH > 0
#ifdef SNORM16
layout(location = 2) in uvec3 deltas[BATCH];
#else
layout(location = 2) in vec3 deltas[2 * BATCH]; // position, normal, position, normal, …
#endif

layout(push_constant) uniform Push {
    float coefficients[BATCH];
#ifdef SNORM16
    uint normal_exponents[(BATCH + 3) / 4];
#endif
};
#endif

void evaluate(out vec3 pose_position, out vec3 pose_normal) {
    // Summed apart and added once: one rounding at pose magnitude per pass.
    vec3 position = vec3(0.0);
    vec3 normal = vec3(0.0);
#if BATCH > 0
    for (uint i = 0u; i < BATCH; ++i) {
#ifdef SNORM16
        vec3 delta_position, delta_normal;
        decode_snorm16(deltas[i], delta_position, delta_normal);
        position += coefficients[i] * delta_position;
        normal += coefficients[i] * normal_ratio(normal_exponents[i >> 2], i) * delta_normal;
#else
        position += coefficients[i] * deltas[2 * i];
        normal += coefficients[i] * deltas[2 * i + 1];
#endif
    }
#endif
    pose_position = source_position + position;
    pose_normal = source_normal + normal;
}
