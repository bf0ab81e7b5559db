use super::*;
use crate::asset::{Corner, MeshArrays, MorphTarget, Semantic, TargetArrays, Tolerance};

/// A strip of two quads, folded along the edge 1-4, with a seam in the texture coordinates there.
fn fold() -> Mesh {
    let corner = |(position, t): (u32, u32)| Corner { position, texcoord: Some(t) };
    let corners = [(0, 0), (1, 1), (4, 2), (3, 3), (1, 0), (2, 1), (5, 2), (4, 4)];
    Mesh {
        name: "fold".into(),
        positions: [[0, 0, 0], [1, 0, 1], [2, 0, 0], [0, 1, 0], [1, 1, 1], [2, 1, 0]]
            .map(|p: [i32; 3]| Vec3::from(p.map(|x| x as f32)))
            .to_vec(),
        texcoords: [[0, 0], [1, 0], [1, 1], [0, 1], [1, 1]].map(|t: [i32; 2]| Vec2::from(t.map(|x| x as f32))).to_vec(),
        faces: Faces { sizes: vec![4, 4], corners: corners.map(corner).to_vec() },
        streams: vec![StreamData { semantic: Semantic::Tangent, values: [0.0, 1.0, 0.0, -1.0].repeat(6) }],
        targets: vec![MorphTarget {
            name: "up".into(),
            positions: vec![(1, Vec3::Z), (4, Vec3::new(0.1, 0.2, 0.3))],
            normals: None,
            streams: vec![StreamDeltas { vertices: vec![1, 2], deltas: vec![0.5, 0.0, 0.0, 0.0, 0.0, 0.25] }],
        }],
        ..Default::default()
    }
}

#[test]
fn a_vertex_is_doubled_where_texture_coordinates_differ_by_value() {
    let mut source = fold();
    source.normals = Some(vec![Vec3::Z; 6]);
    source.targets[0].normals = Some(vec![(1, Vec3::X)]);
    let render = source.faces.render_vertices(&source.positions, &source.texcoords).unwrap();
    // Vertex 4 names two texture coordinates of the same value.
    assert_eq!(render.pose_vertices, [0, 1, 2, 3, 4, 5, 1]);
    assert_eq!(render.indices, [0, 1, 4, 0, 4, 3, 6, 2, 5, 6, 5, 4]);
    assert_eq!((render.texcoords[1], render.texcoords[6]), (Vec2::X, Vec2::ZERO));
    let split = source.split().unwrap();
    // Vertex 6 doubles vertex 1 in all that the mesh says of it; the texture coordinates are as the file lists them.
    assert_eq!((&split.welds[..], split.texcoords == source.texcoords), (&[0, 1, 2, 3, 4, 5, 1][..], true));
    assert_eq!((split.normals.as_ref().map(Vec::len), split.streams[0].values[24..].len()), (Some(7), 4));
    let up = &split.targets[0];
    assert_eq!(
        (up.normals.as_ref(), &up.positions[2..]),
        (Some(&vec![(1, Vec3::X), (6, Vec3::X)]), &[(6, Vec3::Z)][..])
    );
    assert_eq!((&up.streams[0].vertices[..], &up.streams[0].deltas[6..]), (&[1, 2, 6][..], &[0.5, 0.0, 0.0][..]));
    let again = split.faces.render_vertices(&split.positions, &split.texcoords).unwrap();
    assert_eq!(again, RenderVertices { pose_vertices: (0..7).collect(), ..render });
    assert!(source.faces.render_vertices(&source.positions[..5], &source.texcoords).is_err());
}

#[test]
fn doubled_vertices_of_arrays_are_found_by_where_they_are_and_move() {
    // The fold as triangles, its edge doubled by the one who made the arrays.
    let positions = [[0, 0, 0], [1, 0, 1], [0, 1, 0], [1, 1, 1], [1, 0, 1], [2, 0, 0], [1, 1, 1], [2, 1, 0]]
        .map(|p: [i32; 3]| p.map(|x| x as f32));
    let mut moved = [[0.0; 3]; 8];
    (moved[1], moved[4], moved[3]) = ([0., 0., 1.], [0., 0., 1.], [0., 0., 2.]);
    let targets = [TargetArrays { name: "up", positions: &moved, ..Default::default() }];
    let indices = &[0, 1, 3, 0, 3, 2, 4, 5, 7, 4, 7, 6];
    let arrays = MeshArrays { positions: &positions, indices, targets: &targets, ..Default::default() };
    let mut source = Mesh::from_arrays(&arrays).unwrap();
    let cracked = source.kept(Tolerance::default()).unwrap();
    assert_ne!(cracked.normals[1], cracked.normals[4]);
    source.weld().unwrap();
    // Vertices 3 and 6 are at one position, but only one of them moves.
    assert_eq!(source.welds, [0, 1, 2, 3, 1, 5, 6, 7]);
    let mesh = source.kept(Tolerance::default()).unwrap();
    assert_eq!(mesh.normals[1], mesh.normals[4]);
    let target = &mesh.targets[0];
    let delta = |v| target.normals[target.vertices.iter().position(|x| *x == v).unwrap()];
    assert_eq!(delta(1), delta(4));
}

#[test]
fn arrays_may_hold_differences_or_the_target_itself() {
    let base = MeshArrays {
        positions: &[[1.0, 2.0, 3.0]],
        normals: &[[0.0, 0.0, 1.0]],
        tangents: &[[1.0, 0.0, 0.0, -1.0]],
        ..Default::default()
    };
    let (up, z, two) = ([[0.0, 1.0, 0.0]], [[0.0, 0.0, 1.0]], [[0.0; 3]; 2]);
    let [by, turn, twist] = [[[0.5, 0.0, -1.0]], [[0.0, 1.0, -1.0]], [[-1.0, 0.0, 1.0]]];
    let deltas = [TargetArrays { name: "", positions: &by, normals: &turn, tangents: &twist }];
    let places = [TargetArrays { name: "", positions: &[[1.5, 2.0, 2.0]], normals: &up, tangents: &z }];
    let [a, b] = [(&deltas, false), (&places, true)].map(|(targets, absolute)| {
        Mesh::from_arrays(&MeshArrays { targets, absolute, ..base }).unwrap().kept(Tolerance::ZERO).unwrap()
    });
    assert_eq!(a.targets, b.targets);
    assert_eq!(a.targets[0].name, "target 0");
    assert_eq!(a.targets[0].streams[0], StreamDeltas { vertices: vec![0], deltas: vec![-1.0, 0.0, 1.0] });

    let jaw = [TargetArrays { name: "jaw", positions: &two, ..Default::default() }];
    for (arrays, expected) in [
        (MeshArrays { normals: &two, ..base }, "2 normals for 1 vertices"),
        (MeshArrays { targets: &jaw, ..base }, "target 'jaw' has 2 positions, but the base pose has 1"),
        (MeshArrays { indices: &[0], ..base }, "1 indices"),
    ] {
        crate::testing::says(Mesh::from_arrays(&arrays), &[expected]);
    }
}

#[test]
fn what_is_no_mesh_is_refused_with_its_place() {
    type Case<'a> = (&'a dyn Fn(&mut Mesh), &'a str);
    let cases: [Case<'_>; 24] = [
        (&|s| s.origin.y = f32::NAN, "an origin of"),
        (&|s| s.streams[0].values.truncate(20), "stream 'tangent': 20 numbers for 6 vertices; give 4"),
        (&|s| s.streams[0].values[9] = f32::NAN, "the tangent of vertex 2 is [0.0, NaN, 0.0, -1.0]; replace"),
        (&|s| s.streams[0].values[9] = 1.1, "the tangent of vertex 2 is [0.0, 1.1, 0.0, -1.0]; normalise"),
        (&|s| s.streams[0].values[3] = 0.5, "the tangent of vertex 0 is"),
        (&|s| s.streams.push(s.streams[0].clone()), "two streams 'tangent'"),
        (&|s| s.streams[0].semantic = Semantic::Normal, "a further stream 'normal'; use the fields"),
        (&|s| s.targets[0].streams.push(StreamDeltas::default()), "target 'up' has deltas of 2 streams"),
        (&|s| s.targets[0].streams[0].deltas.truncate(5), "5 numbers for 2 vertices in the deltas of stream 'tangent'"),
        (&|s| s.targets[0].streams[0].vertices = vec![2, 1], "among the tangent deltas, vertex 1 comes after vertex 2"),
        (&|s| s.targets[0].streams[0].vertices[1] = 6, "a tangent delta of vertex 6, there are 6 vertices"),
        (&|s| s.targets[0].streams[0].deltas[0] = f32::INFINITY, "the tangent delta of vertex 1 is [inf, 0.0, 0.0]"),
        (&|s| s.welds = vec![0, 1, 1, 3, 4, 5], "vertex 2 is welded to vertex 1, but their positions differ in some"),
        (&|s| s.welds = vec![1, 1, 2, 3, 4, 5], "vertex 0 is welded to vertex 1, which is not the first at its"),
        (&|s| s.welds = vec![0; 5], "5 welds for 6 vertices"),
        (&|s| s.targets.push(s.targets[0].clone()), "targets 0 and 1 are both called 'up'"),
        (&|s| s.positions.clear(), "no vertex"),
        (&|s| s.positions[2].y = f32::NAN, "vertex 2"),
        (&|s| (s.positions[3].x, s.positions[4].x) = (f32::MAX, f32::MIN), "scale the mesh down"),
        (&|s| s.targets[0].positions = vec![(6, Vec3::X)], "'up': a position delta of vertex 6, there are 6"),
        (&|s| s.targets[0].positions = vec![(1, Vec3::X), (1, Vec3::X)], "vertex 1 comes after vertex 1"),
        (&|s| s.targets[0].positions = vec![(1, Vec3::INFINITY)], "position delta of vertex 1"),
        (&|s| s.normals = Some(vec![Vec3::Z]), "1 normals for 6 vertices"),
        (&|s| s.normals = Some(vec![Vec3::ZERO; 6]), "the normal of vertex 0"),
    ];
    for (change, expected) in cases {
        let mut source = fold();
        change(&mut source);
        let message = source.kept(Tolerance::default()).unwrap_err().to_string();
        assert!(message.starts_with("fold: ") && message.contains(expected), "{message}");
    }
    let [mut torn, mut short, mut worn] = [fold(), fold(), fold()];
    (torn.faces.corners[0].position, short.faces.sizes[0]) = (9, 2);
    worn.faces.corners[0].texcoord = Some(9);
    for (refused, expected) in [
        (torn.kept(Tolerance::default()).map(drop), "vertex 9, there are 6"),
        (worn.kept(Tolerance::default()).map(drop), "texture coordinate 9, there are 5"),
        (short.kept(Tolerance::default()).map(drop), "corners"),
        (torn.split().map(drop), "vertex 9"),
        (torn.weld().map(drop), "vertex 9"),
        (short.faces.render_vertices(&short.positions, &short.texcoords).map(drop), "corners"),
        (short.kept(Tolerance { position: -1.0, normal: 0.0 }).map(drop), "position tolerance is -1"),
    ] {
        crate::testing::says(refused, &[expected]);
    }
}

#[test]
fn noise_in_a_stream_is_dropped_and_a_stream_without_deltas_stays() {
    let mut source = fold();
    source.targets[0].streams[0].deltas[3..].fill(1e-4);
    source.streams.push(StreamData { semantic: Semantic::Color(0), values: vec![0.5; 24] });
    let mesh = source.kept(Tolerance::default()).unwrap();
    assert_eq!(mesh.targets[0].streams[0].vertices, [1]);
    assert_eq!((mesh.streams.len(), &mesh.targets[0].streams[1]), (2, &StreamDeltas::default()));
    assert_eq!(source.kept(Tolerance::ZERO).unwrap().targets[0].streams[0].vertices, [1, 2]);
}
