// Stores the vertex of a vertex shader where the host's draws read it.

#ifndef POSE_BINDING
#define POSE_BINDING 0
#endif
layout(set = 0, binding = POSE_BINDING, std430) writeonly buffer DestinationPose { POSE_ELEMENT destination_pose[]; };

void store_pose(uint vertex, vec3 position, vec3 normal) {
    STORE_POSE(destination_pose, vertex, position, normal)
}
