// Reads poses of deltamorph in your vertex shader, from vertex attributes. Copy this file, or include it: it only needs
// GLSL 4.40 or later. Before it, define
//
//     POSE_FLOAT32, POSE_FIXED32 or POSE_FIXED16   the crowd's PoseFormat::decoder
//     POSE_LOCATION                                the first of its locations, if that is not 0
//     POSE_PREVIOUS                                for motion vectors: the previous pose, too
//
// It declares the inputs, in the locations that PoseFormat::vertex_input lists, and
//     vec3 pose_position(), pose_normal(), previous_position(), previous_normal()
//
// PoseView::matrix, the same for all instances of a crowd, makes positions of the mesh of what it returns: multiply the
// model matrix by it from the right. Normals are directions as they are, not normalised.

#ifndef POSE_LOCATION
#define POSE_LOCATION 0
#endif

// The two attributes of a format.
#if defined(POSE_FLOAT32)
#define POSE_FIRST vec3
#define POSE_SECOND vec3
#elif defined(POSE_FIXED32)
#define POSE_FIRST ivec3
#define POSE_SECOND ivec3
#elif defined(POSE_FIXED16)
#define POSE_FIRST ivec4
#define POSE_SECOND ivec2
#define POSE_NORMAL(first, second) vec3(first.w, second)
#else
#error "define POSE_FLOAT32, POSE_FIXED32 or POSE_FIXED16 before this file"
#endif
#ifndef POSE_NORMAL
#define POSE_NORMAL(first, second) vec3(second)
#endif

#define POSE_INPUTS(name, at) \
    layout(location = POSE_LOCATION + at) in POSE_FIRST name##_first; \
    layout(location = POSE_LOCATION + at + 1) in POSE_SECOND name##_second; \
    vec3 name##_position() { return vec3(name##_first.xyz); } \
    vec3 name##_normal() { return POSE_NORMAL(name##_first, name##_second); }

POSE_INPUTS(pose, 0)
#ifdef POSE_PREVIOUS
POSE_INPUTS(previous, 2)
#endif
