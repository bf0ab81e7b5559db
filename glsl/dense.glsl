// Shared by the two dense compute kernels: bindings, and the work on one vertex around the sum.

#include "abi.glsl"
#include "aliased.glsl"
#include "pose.glsl"

layout(local_size_x = WORKGROUP) in;

// Both are bound at the first vertex of the chunk. An in-place pass binds the same memory twice: an invocation stores a
// result that depends on its own vertex alone, so that each load precedes its store by data dependency, and no
// invocation reads another's vertex. (Never `restrict`.)
ALIASED layout(set = 0, binding = 0, std430) readonly buffer SourcePose { POSE_ELEMENT source_pose[]; };
ALIASED layout(set = 0, binding = 1, std430) writeonly buffer DestinationPose { POSE_ELEMENT destination_pose[]; };
#define DELTAS_BINDING 2
#include "dense_formats.glsl"
