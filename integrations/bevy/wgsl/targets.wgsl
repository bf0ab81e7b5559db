// Write poses of deltamorph as morph targets of Bevy: what a pose adds to the base pose, in the order of the mesh.

struct Constants {
    // Of the units of integers: positions, normals, tangents.
    units: vec4f,
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
// `MorphAttributes` of Bevy, three elements for each vertex: position, normal, tangent.
@group(0) @binding(5) var<storage, read_write> targets: array<vec4f>;

@compute @workgroup_size(64)
fn write_targets(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= constants.vertices {
        return;
    }
    let instance = moves[id.y];
    let vertex = 6u * order[id.x];
    let at = instance.target_begin + 3u * id.x;
    let p = instance.pose + vertex;
    targets[at] = vec4f(vec3f(vec3i(poses[p], poses[p + 1u], poses[p + 2u])) * constants.units.x, 0.0);
    targets[at + 1u] = vec4f(vec3f(vec3i(poses[p + 3u], poses[p + 4u], poses[p + 5u])) * constants.units.y, 0.0);
    if constants.has_tangents != 0u {
        let t = instance.tangents + vertex;
        targets[at + 2u] = vec4f(vec3f(vec3i(tangents[t], tangents[t + 1u], tangents[t + 2u])) * constants.units.z, 0.0);
    }
}
