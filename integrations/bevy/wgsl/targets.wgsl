// Write poses of deltamorph as morph targets of Bevy: what a pose adds to the vertices of the mesh, in their order.

struct Constants {
    // A component of a position is offset + integer × unit, of a direction integer × unit.
    position_unit: vec3f,
    normal_unit: f32,
    position_offset: vec3f,
    tangent_unit: f32,
    vertices: u32,
    has_tangents: u32,
}

// An instance whose pose is new. Words, and elements of 16 bytes.
struct Move {
    pose: u32,
    tangents: u32,
    target_begin: u32,
    padding: u32,
}

@group(0) @binding(0) var<uniform> constants: Constants;
// Six integers of a vertex: position and normal; tangent, its sign, and two that nobody uses.
@group(0) @binding(1) var<storage, read> poses: array<i32>;
@group(0) @binding(2) var<storage, read> tangents: array<i32>;
// Where each vertex of the mesh is in a pose.
@group(0) @binding(3) var<storage, read> order: array<u32>;
@group(0) @binding(4) var<storage, read> moves: array<Move>;
// Position, normal and tangent of each vertex of the mesh.
@group(0) @binding(5) var<storage, read> base: array<f32>;
// `MorphAttributes` of Bevy, three elements for each vertex: position, normal, tangent.
@group(0) @binding(6) var<storage, read_write> targets: array<vec4f>;

// `i` counts the vectors of the mesh, and of a target.
fn write_vector(target_begin: u32, i: u32, value: vec3f) {
    let still = vec3f(base[3u * i], base[3u * i + 1u], base[3u * i + 2u]);
    targets[target_begin + i] = vec4f(value - still, 0.0);
}

@compute @workgroup_size(64)
fn write_targets(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= constants.vertices {
        return;
    }
    let instance = moves[id.y];
    let vertex = 6u * order[id.x];
    let p = instance.pose + vertex;
    let position = vec3f(vec3i(poses[p], poses[p + 1u], poses[p + 2u]));
    let normal = vec3f(vec3i(poses[p + 3u], poses[p + 4u], poses[p + 5u]));
    let to = instance.target_begin;
    write_vector(to, 3u * id.x, constants.position_offset + position * constants.position_unit);
    write_vector(to, 3u * id.x + 1u, normal * constants.normal_unit);
    if constants.has_tangents != 0u {
        let t = instance.tangents + vertex;
        let tangent = vec3f(vec3i(tangents[t], tangents[t + 1u], tangents[t + 2u]));
        write_vector(to, 3u * id.x + 2u, tangent * constants.tangent_unit);
    }
}
