// Write a pose of deltamorph over the vertices of a mesh, or the vertices as they were.

struct Constants {
    // A component of a position is offset + integer × unit, of a direction integer × unit.
    position_unit: vec3f,
    normal_unit: f32,
    position_offset: vec3f,
    tangent_unit: f32,
    vertices: u32,
    // Words of a vertex, and where its attributes are in it; NONE: it has no such attribute.
    stride: u32,
    position: u32,
    normal: u32,
    tangent: u32,
}

// Words, from the beginnings of the bindings.
struct Move {
    pose: u32,
    tangents: u32,
    vertices: u32,
    // 0: the vertices are written as they were.
    is_posed: u32,
}

const NONE = 0xffffffffu;

@group(0) @binding(0) var<uniform> constants: Constants;
// Six integers of a vertex: position and normal; tangent, its sign, and two that nobody uses.
@group(0) @binding(1) var<storage, read> poses: array<i32>;
@group(0) @binding(2) var<storage, read> tangents: array<i32>;
// Where each vertex of the mesh is in a pose.
@group(0) @binding(3) var<storage, read> order: array<u32>;
@group(0) @binding(4) var<uniform> place: Move;
// Position, normal and tangent of each vertex of the mesh.
@group(0) @binding(5) var<storage, read> base: array<f32>;
@group(0) @binding(6) var<storage, read_write> vertices: array<f32>;

fn write_vector(at: u32, at_base: u32, value: vec3f) {
    for (var i = 0u; i < 3u; i++) {
        vertices[at + i] = select(base[at_base + i], value[i], place.is_posed != 0u);
    }
}

@compute @workgroup_size(64)
fn write_vertices(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= constants.vertices {
        return;
    }
    let vertex = 6u * order[id.x];
    let at = place.vertices + constants.stride * id.x;
    let at_base = 9u * id.x;
    let p = place.pose + vertex;
    let position = vec3f(vec3i(poses[p], poses[p + 1u], poses[p + 2u]));
    write_vector(at + constants.position, at_base, constants.position_offset + position * constants.position_unit);
    if constants.normal != NONE {
        let normal = vec3f(vec3i(poses[p + 3u], poses[p + 4u], poses[p + 5u]));
        write_vector(at + constants.normal, at_base + 3u, normal * constants.normal_unit);
    }
    if constants.tangent != NONE {
        let t = place.tangents + vertex;
        let tangent = vec3f(vec3i(tangents[t], tangents[t + 1u], tangents[t + 2u]));
        write_vector(at + constants.tangent, at_base + 6u, tangent * constants.tangent_unit);
    }
}
