// Shared by the steps after the pose that write vertices: a lane processes a vertex, PIECE lanes a piece. The including
// file declares the push constants `vertices`, `count` and `listed`, and defines PIECE_AT(i), a piece of the list.

// Returns `vertices` or more if the lane has no vertex.
uint vertex_of_lane() {
    uint at = gl_GlobalInvocationID.x / PIECE;
    if (at >= count) {
        return vertices;
    }
    uint piece = listed != 0u ? PIECE_AT(at) : at;
    return piece * PIECE + gl_GlobalInvocationID.x % PIECE;
}
