// A vertex stage over BATCH targets bound as vertex attributes: source + Σ coefficient · delta. CPU twin:
// cpu::kernel::dense.
#include "pose.glsl"
#include "dense_formats.glsl"

layout(location = 0) in vec3 source_position;
layout(location = 1) in vec3 source_normal;

void evaluate(out vec3 pose_position, out vec3 pose_normal) {
    // Summed separately and added once: one rounding at the magnitude of the pose per pass.
    vec3 position = vec3(0.0);
    vec3 normal = vec3(0.0);
#if BATCH > 0
    for (uint i = 0u; i < BATCH; ++i) {
        ADD_ATTRIBUTES(i, position, normal)
    }
#endif
    pose_position = source_position + position;
    pose_normal = source_normal + normal;
}
