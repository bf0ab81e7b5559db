// Fixed-point poses: integers. The including format defines LOAD_VERTEX and
// STORE_VERTEX, and as POSE_ELEMENT the element of a storage buffer that is loaded and stored by vertices.
#define INTEGER_POSES
#define NUMBER int
#define ADDEND ivec3

// Adds a vertex of `source`. Sums wrap.
#define ADD_POSE(source, vertex, position, normal) { \
    ivec3 source_position, source_normal; \
    LOAD_VERTEX(source, 6u * vertex, source_position, source_normal) \
    position += source_position; \
    normal += source_normal; \
}
#define STORE_POSE(destination, vertex, position, normal) STORE_VERTEX(destination, 6u * vertex, position, normal)
