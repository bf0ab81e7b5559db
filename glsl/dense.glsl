// What the two dense compute kernels share: bindings and one vertex's work around the sum.

#include "abi.glsl"
#include "aliased.glsl"

layout(local_size_x = WORKGROUP) in;

// Both are bound at the first vertex of the chunk. An in-place pass binds the same memory twice: an invocation
// stores what it computed from its own vertex alone, so that each load precedes its store by data dependency and no
// invocation reads another's vertex. (Never `restrict`.)
ALIASED layout(set = 0, binding = 0, std430) readonly buffer SourcePose { vec2 source_pose[]; };
ALIASED layout(set = 0, binding = 1, std430) writeonly buffer DestinationPose { vec2 destination_pose[]; };
#define DELTAS_BINDING 2
#include "dense_formats.glsl"

// destination = source + sum: one rounding at pose magnitude.
void store_pose(uint vertex, vec3 position, vec3 normal) {
    vec2 a = source_pose[3u * vertex], b = source_pose[3u * vertex + 1u], c = source_pose[3u * vertex + 2u];
    destination_pose[3u * vertex] = a + position.xy;
    destination_pose[3u * vertex + 1u] = b + vec2(position.z, normal.x);
    destination_pose[3u * vertex + 2u] = c + normal.yz;
}
