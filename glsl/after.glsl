// The steps after the pose that write vertices: a lane takes a vertex, PIECE lanes take a piece. Whoever includes this has
// the push constants `vertices`, `count` and `listed`, and defines PIECE_AT(i), a piece of the list.

// `vertices` or more: none.
uint vertex_of_lane() {
    uint place = gl_GlobalInvocationID.x / PIECE;
    if (place >= count) {
        return vertices;
    }
    uint piece = listed != 0u ? PIECE_AT(place) : place;
    return piece * PIECE + gl_GlobalInvocationID.x % PIECE;
}
