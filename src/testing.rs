//! Meshes made up for tests: small, irregular, deterministic.

use crate::asset::{MorphMesh, MorphTarget, Tolerance, diagonal};
use glam::Vec3;

fn noise(mut x: u64) -> f32 {
    x = (x ^ (x >> 31)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    x = (x ^ (x >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    ((x >> 40) as f32 / (1u64 << 23) as f32) - 1.0
}

fn vector(seed: u64) -> Vec3 {
    Vec3::new(noise(seed * 3 + 1), noise(seed * 3 + 2), noise(seed * 3 + 3))
}

/// `vertices` random points, `targets` targets that each move two vertices of three; target 2 is empty.
pub fn mesh(vertices: usize, targets: usize) -> MorphMesh {
    let positions: Vec<Vec3> = (0..vertices as u64).map(|i| vector(i) * 10.0).collect();
    let target = |t: usize| {
        let moved: Vec<u32> = (0..vertices as u32).filter(|v| t != 2 && !(*v as usize + t).is_multiple_of(3)).collect();
        let seeded =
            |salt: u64| moved.iter().map(|&v| vector(u64::from(v) + (t as u64 + 1) * 1_000_003 + salt)).collect();
        let (positions, normals): (Vec<Vec3>, Vec<Vec3>) = (seeded(7), seeded(11));
        MorphTarget {
            name: format!("target_{t}"),
            positions,
            normals: normals.iter().map(|n| *n * 0.1).collect(),
            vertices: moved,
            streams: vec![],
        }
    };
    MorphMesh {
        name: format!("test_{vertices}x{targets}"),
        diagonal: diagonal(&positions),
        normals: (0..vertices as u64).map(|i| vector(i + 500_000).try_normalize().unwrap_or(Vec3::Z)).collect(),
        positions,
        targets: (0..targets).map(target).collect(),
        tolerance: Tolerance::ZERO,
        ..MorphMesh::default()
    }
}

/// Meshes that have next to nothing: of one vertex, without targets, with more targets than vertices, with nothing but
/// empty targets.
pub fn degenerate() -> Vec<MorphMesh> {
    let mut empty = mesh(100, 5);
    for target in &mut empty.targets {
        *target = MorphTarget { name: target.name.clone(), ..Default::default() };
    }
    let sizes = [(1, 1), (1, 0), (63, 3), (64, 1), (65, 0), (2, 300)];
    sizes.into_iter().map(|(vertices, targets)| mesh(vertices, targets)).chain([empty]).collect()
}
