// Poses of deltamorph in WGSL: the numbers of a vertex.
//
// `PoseView::matrix`, the same for all heads of a crowd, makes positions of the mesh of what is returned here: multiply
// the model matrix by it from the right. Normals are directions as they are, not normalised.

struct PoseVertex {
    position: vec3f,
    normal: vec3f,
}

// Vertex attributes, as `VertexInput` lists them.

fn pose_float32(first: vec3f, second: vec3f) -> PoseVertex {
    return PoseVertex(first, second);
}

fn pose_fixed32(first: vec3i, second: vec3i) -> PoseVertex {
    return PoseVertex(vec3f(first), vec3f(second));
}

fn pose_fixed16(first: vec4i, second: vec2i) -> PoseVertex {
    return PoseVertex(vec3f(first.xyz), vec3f(vec3i(first.w, second)));
}

// Storage buffers, in compute and vertex shaders: the words of a vertex. Vertex i begins at word 6 * i of float32 and
// fixed32, at word 3 * i of fixed16, counted from `PoseView::offset`.

fn pose_words_float32(first: vec3u, second: vec3u) -> PoseVertex {
    return pose_float32(bitcast<vec3f>(first), bitcast<vec3f>(second));
}

fn pose_words_fixed32(first: vec3u, second: vec3u) -> PoseVertex {
    return pose_fixed32(bitcast<vec3i>(first), bitcast<vec3i>(second));
}

fn pose_words_fixed16(words: vec3u) -> PoseVertex {
    let low = bitcast<vec3i>(words << vec3u(16u)) >> vec3u(16u);
    let high = bitcast<vec3i>(words) >> vec3u(16u);
    return pose_fixed16(vec4i(low.x, high.x, low.y, high.y), vec2i(low.z, high.z));
}
