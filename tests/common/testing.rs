//! Meshes made up for tests: small, irregular, deterministic.

#![allow(dead_code, reason = "each program uses some of it")]

use deltamorph::glam::Vec3;
use deltamorph::internals::diagonal;
use deltamorph::mesh::{KeptTarget, StreamData, StreamDeltas};
use deltamorph::{KeptMesh, Semantic, Tolerance};

/// Checks that `result` is an error whose text has each of `words`.
pub fn says<T, E: std::fmt::Display>(result: Result<T, E>, words: &[&str]) {
    let text = result.err().unwrap_or_else(|| panic!("not refused: {words:?}")).to_string();
    assert!(words.iter().all(|word| text.contains(word)), "{words:?}: {text}");
}

fn noise(mut x: u64) -> f32 {
    x = (x ^ (x >> 31)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    x = (x ^ (x >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    ((x >> 40) as f32 / (1u64 << 23) as f32) - 1.0
}

fn vector(seed: u64) -> Vec3 {
    Vec3::new(noise(seed * 3 + 1), noise(seed * 3 + 2), noise(seed * 3 + 3))
}

/// `vertices` random points, `targets` targets that each move two vertices of three; target 2 is empty.
pub fn mesh(vertices: usize, targets: usize) -> KeptMesh {
    let positions: Vec<Vec3> = (0..vertices as u64).map(|i| vector(i) * 10.0).collect();
    let target = |t: usize| {
        let moved: Vec<u32> = (0..vertices as u32).filter(|v| t != 2 && !(*v as usize + t).is_multiple_of(3)).collect();
        let seeded =
            |salt: u64| moved.iter().map(|&v| vector(u64::from(v) + (t as u64 + 1) * 1_000_003 + salt)).collect();
        let (positions, normals): (Vec<Vec3>, Vec<Vec3>) = (seeded(7), seeded(11));
        KeptTarget {
            name: format!("target_{t}"),
            positions,
            normals: normals.iter().map(|n| *n * 0.1).collect(),
            vertices: moved,
            streams: vec![],
        }
    };
    KeptMesh {
        name: format!("test_{vertices}x{targets}"),
        diagonal: diagonal(&positions),
        normals: (0..vertices as u64).map(|i| vector(i + 500_000).try_normalize().unwrap_or(Vec3::Z)).collect(),
        positions,
        targets: (0..targets).map(target).collect(),
        tolerance: Tolerance::ZERO,
        ..KeptMesh::default()
    }
}

/// `mesh` with tangents, texture coordinates, colours and wrinkle masks, which its targets move as well, and a few
/// vertices besides.
pub fn with_streams(mut mesh: KeptMesh) -> KeptMesh {
    let vertices = mesh.vertex_count();
    let handed = |v: u64| if v.is_multiple_of(2) { 1.0 } else { -1.0 };
    let tangent = |v: u64| vector(v + 900_000).try_normalize().unwrap_or(Vec3::X).extend(handed(v)).to_array();
    let numbers = |semantic: Semantic, salt: u64| {
        let noise = move |v: u64| (0..semantic.components() as u64).map(move |c| 0.5 + 0.5 * noise(salt + 4 * v + c));
        StreamData { semantic, values: (0..vertices as u64).flat_map(noise).collect() }
    };
    mesh.streams = vec![
        StreamData { semantic: Semantic::Tangent, values: (0..vertices as u64).flat_map(tangent).collect() },
        numbers(Semantic::TexCoord(0), 1_000_000),
        numbers(Semantic::Color(0), 2_000_000),
        numbers(Semantic::Mask, 3_000_000),
    ];
    for (t, target) in mesh.targets.iter_mut().enumerate() {
        let moved: Vec<u32> = (0..vertices as u32).filter(|v| t != 2 && (*v as usize + t) % 4 < 2).collect();
        let deltas = |stream: &StreamData| {
            let each = stream.semantic.morphing_components() as u64;
            let salt = (t as u64 + 1) * 7_000_003 + each;
            let delta = |v: &u32| (0..each).map(move |c| 0.1 * noise(salt + 4 * u64::from(*v) + c)).collect::<Vec<_>>();
            StreamDeltas { deltas: moved.iter().flat_map(delta).collect(), vertices: moved.clone() }
        };
        target.streams = mesh.streams.iter().map(deltas).collect();
    }
    mesh
}

/// A mesh whose groups reach very different ranges, determined by `seed`: a vertex far from the others, texture
/// coordinates of many tiles, bright colours, or none of these.
pub fn uneven(seed: u64) -> KeptMesh {
    let dice = |salt: u64, sides: f32| ((noise(seed * 16 + salt) + 1.0) / 2.0 * sides) as usize;
    let (vertices, targets) = ([40, 130, 300][dice(1, 3.0)], [3, 12, 60][dice(2, 3.0)]);
    let mut mesh = with_streams(mesh(vertices, targets));
    mesh.positions[vertices / 2] += vector(seed) * 10f32.powi(dice(3, 5.0) as i32);
    for (s, stream) in (0..).zip(&mut mesh.streams).filter(|(_, stream)| stream.semantic != Semantic::Tangent) {
        let [range, moved] = [10f32.powi(dice(4 + s, 5.0) as i32 - 1), 4f32.powi(dice(8 + s, 4.0) as i32)];
        stream.values.iter_mut().for_each(|value| *value *= range);
        let deltas = mesh.targets.iter_mut().flat_map(|target| &mut target.streams[s as usize].deltas);
        deltas.for_each(|delta| *delta *= moved.min(range));
    }
    mesh
}

/// How many random meshes a test tries: `default`, unless PROPTEST_CASES says how many.
pub fn cases(default: u64) -> u64 {
    std::env::var("PROPTEST_CASES").ok().and_then(|cases| cases.parse().ok()).unwrap_or(default)
}

/// Meshes that have next to nothing: of one vertex, without targets, with more targets than vertices, with nothing but
/// empty targets.
pub fn degenerate() -> Vec<KeptMesh> {
    let mut empty = mesh(100, 5);
    for target in &mut empty.targets {
        *target = KeptTarget { name: target.name.clone(), ..Default::default() };
    }
    let sizes = [(1, 1), (1, 0), (63, 3), (64, 1), (65, 0), (2, 300)];
    sizes.into_iter().map(|(vertices, targets)| mesh(vertices, targets)).chain([empty]).collect()
}
