// Decodes poses of deltamorph in your vertex shader, from vertex attributes alone. Copy this file, or include it: it
// only needs GLSL 4.40 or later. Before it, define
//
//     POSE_FLOAT32, POSE_FIXED32 or POSE_FIXED16   the crowd's PoseFormat::decoder
//     POSE_LOCATION                                the first of its locations, if that is not 0
//     POSE_PREVIOUS                                for motion vectors: the previous pose, too
//
// It declares the inputs, in as many locations as PoseFormat::vertex_input lists, and
//
//     vec3 pose_position(vec2 units), pose_normal(vec2 units)
//     vec3 previous_position(vec2 units), previous_normal(vec2 units)
//
// Results are in units of the mesh, relative to PackedLayout::origin; normals are not normalised. `units` is
// PoseView::units, equal for all instances of a crowd (a push constant, for example); POSE_FLOAT32 ignores it.
//
// Bindings on the host: 0 is the pose (Crowd::pose). With fixed formats the base pose is next, which all instances of a
// mesh share (GpuMesh::base_pose). The previous pose is the last one, with the same attributes as the pose.

#ifndef POSE_LOCATION
#define POSE_LOCATION 0
#endif

// The two attributes of a format: position, and normal.
#if defined(POSE_FLOAT32)
#define POSE_FIRST vec3
#define POSE_SECOND vec3
#define POSE_DECODED(triple, base, unit) triple
#elif defined(POSE_FIXED32)
#define POSE_FIRST ivec3
#define POSE_SECOND ivec3
#elif defined(POSE_FIXED16)
#define POSE_FIRST ivec4
#define POSE_SECOND ivec2
#define POSE_NORMAL(first, second) ivec3(first.w, second)
#else
#error "define POSE_FLOAT32, POSE_FIXED32 or POSE_FIXED16 before this file"
#endif
#ifndef POSE_NORMAL
#define POSE_NORMAL(first, second) second
#endif

#ifdef POSE_DECODED
#define POSE_PREVIOUS_LOCATION POSE_LOCATION + 2
#else
#define POSE_PREVIOUS_LOCATION POSE_LOCATION + 4
// Integers are the displacement from the base pose. Units are powers of two: the product is exact below 24 bits, and
// the result is the same if it is fused with the sum.
vec3 pose_displaced(vec3 base, ivec3 displacement, float unit) {
    return base + vec3(displacement) * unit;
}
#define POSE_DECODED(triple, base, unit) pose_displaced(base, triple, unit)
#endif

// In other shaders than vertex shaders: pose_displaced alone.
#ifndef POSE_WITHOUT_INPUTS

layout(location = POSE_LOCATION) in POSE_FIRST pose_first;
layout(location = POSE_LOCATION + 1) in POSE_SECOND pose_second;
#ifndef POSE_FLOAT32
layout(location = POSE_LOCATION + 2) in vec3 base_position;
layout(location = POSE_LOCATION + 3) in vec3 base_normal;
#endif

vec3 pose_position(vec2 units) {
    return POSE_DECODED(pose_first.xyz, base_position, units.x);
}

vec3 pose_normal(vec2 units) {
    return POSE_DECODED(POSE_NORMAL(pose_first, pose_second), base_normal, units.y);
}

#ifdef POSE_PREVIOUS
layout(location = POSE_PREVIOUS_LOCATION) in POSE_FIRST previous_first;
layout(location = POSE_PREVIOUS_LOCATION + 1) in POSE_SECOND previous_second;

vec3 previous_position(vec2 units) {
    return POSE_DECODED(previous_first.xyz, base_position, units.x);
}

vec3 previous_normal(vec2 units) {
    return POSE_DECODED(POSE_NORMAL(previous_first, previous_second), base_normal, units.y);
}
#endif

#endif
