// Poses of deltamorph in WGSL: positions and normals in units of the mesh. Normals are not normalised.
//
// `units` is `PoseView::units`, one for all heads of a crowd. Fixed formats take the base pose, which all heads of a mesh
// share. For motion vectors decode the previous pose in the same way, with the same base pose.

struct PoseVertex {
    position: vec3f,
    normal: vec3f,
}

// Integers are the displacement from the base pose. Units are powers of two: products are exact below 24 bits, and where
// one is fused with the sum the result is the same.
fn pose_displaced(position: vec3i, normal: vec3i, base: PoseVertex, units: vec2f) -> PoseVertex {
    return PoseVertex(base.position + vec3f(position) * units.x, base.normal + vec3f(normal) * units.y);
}

// Vertex attributes, as `VertexInput` lists them: first and second of the pose, first and second of the base pose.

fn pose_float32(first: vec3f, second: vec3f) -> PoseVertex {
    return PoseVertex(first, second);
}

fn pose_fixed32(first: vec3i, second: vec3i, base_first: vec3f, base_second: vec3f, units: vec2f) -> PoseVertex {
    return pose_displaced(first, second, PoseVertex(base_first, base_second), units);
}

fn pose_fixed16(first: vec4i, second: vec2i, base_first: vec3f, base_second: vec3f, units: vec2f) -> PoseVertex {
    return pose_displaced(first.xyz, vec3i(first.w, second), PoseVertex(base_first, base_second), units);
}

// Storage buffers, in compute and vertex shaders: the words of a vertex. Vertex i begins at word 6 * i of float32 and
// fixed32, at word 3 * i of fixed16, counted from `PoseView::offset`.

fn pose_words_float32(first: vec3u, second: vec3u) -> PoseVertex {
    return PoseVertex(bitcast<vec3f>(first), bitcast<vec3f>(second));
}

fn pose_words_fixed32(first: vec3u, second: vec3u, base: PoseVertex, units: vec2f) -> PoseVertex {
    return pose_displaced(bitcast<vec3i>(first), bitcast<vec3i>(second), base, units);
}

fn pose_words_fixed16(words: vec3u, base: PoseVertex, units: vec2f) -> PoseVertex {
    let low = bitcast<vec3i>(words << vec3u(16u)) >> vec3u(16u);
    let high = bitcast<vec3i>(words) >> vec3u(16u);
    return pose_displaced(vec3i(low.x, high.x, low.y), vec3i(high.y, low.z, high.z), base, units);
}
