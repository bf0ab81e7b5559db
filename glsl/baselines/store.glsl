// A vertex shader's own vertex, stored where the host's draws read it.

#ifndef POSE_BINDING
#define POSE_BINDING 0
#endif
layout(set = 0, binding = POSE_BINDING, std430) writeonly buffer DestinationPose { vec2 destination_pose[]; };

void store_pose(uint vertex, vec3 position, vec3 normal) {
    destination_pose[3u * vertex] = position.xy;
    destination_pose[3u * vertex + 1u] = vec2(position.z, normal.x);
    destination_pose[3u * vertex + 2u] = normal.yz;
}
