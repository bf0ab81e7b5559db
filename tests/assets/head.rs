//! The built-in head and its clip.

use crate::prelude::*;

fn desc(vertices: usize, targets: usize, sparsity: f32) -> HeadDesc {
    HeadDesc { vertices, targets, sparsity, ..Default::default() }
}

/// FNV-1a.
fn hash(words: impl Iterator<Item = u32>) -> u64 {
    words.fold(0xcbf2_9ce4_8422_2325, |h, x| (h ^ u64::from(x)).wrapping_mul(0x100_0000_01b3))
}

/// Hashes the bits of the surface and the targets.
fn fingerprint(source: &Mesh) -> u64 {
    let base = source.positions.iter().flat_map(|p| p.to_array()).map(f32::to_bits);
    let faces = source.faces.corners.iter().map(|c| c.position);
    let deltas = source.targets.iter().flat_map(|t| &t.positions);
    let deltas = deltas.flat_map(|(v, d)| [*v, d.x.to_bits(), d.y.to_bits(), d.z.to_bits()]);
    hash(base.chain(faces).chain(deltas))
}

#[test]
fn the_number_of_vertices_is_exact() {
    for n in (5..120).chain([255, 419, 1000, 2694, 4097, 43_788]) {
        let source = head(&desc(n, 3, 0.3));
        assert_eq!(source.positions.len(), n);
        let mesh = source.kept(Tolerance::default()).unwrap();
        assert_eq!(mesh.targets.len(), 3);
        let mut used = vec![false; n];
        mesh.faces.corners.iter().for_each(|c| used[c.position as usize] = true);
        assert!(used.iter().all(|u| *u), "{n}: a vertex without a face");
    }
}

#[test]
fn the_same_description_gives_the_same_bits() {
    // The same on every machine. A deliberate change of the head changes these numbers.
    let d = desc(3000, 60, 0.12);
    assert_eq!(fingerprint(&head(&d)), fingerprint(&head(&d)));
    assert_eq!(format!("{:016x}", fingerprint(&head(&d))), FINGERPRINT);
    let source = head(&d);
    let texcoords = source.texcoords.iter().flat_map(|t| t.to_array()).map(f32::to_bits);
    let indices = source.faces.corners.iter().map(|c| c.texcoord.unwrap());
    assert_eq!(format!("{:016x}", hash(texcoords.chain(indices))), TEXCOORDS);
    let clip = head_clip(&d, 900, 30.0);
    assert_eq!(format!("{:016x}", hash(clip.values.iter().map(|w| w.to_bits()))), CLIP);
    let other = head(&HeadDesc { seed: 2, ..d.clone() });
    assert_eq!(other.positions, head(&d).positions);
    assert_ne!(fingerprint(&other), fingerprint(&head(&d)));
}

const FINGERPRINT: &str = "2e8570566a1bd2bf";
const TEXCOORDS: &str = "f677b48a213180df";
const CLIP: &str = "28ec966d77f7a514";

#[test]
fn the_first_targets_have_the_arkit_names() {
    let source = head(&desc(500, 60, 0.1));
    let names: Vec<&str> = source.targets.iter().map(|t| t.name.as_str()).collect();
    assert_eq!((names[0], names[17], names[51]), ("eyeBlinkLeft", "jawOpen", "tongueOut"));
    assert_eq!((names[52], names[59]), ("detail_053", "detail_060"));
    // The left half of the face is at +X.
    let blink = &source.targets[0].positions;
    let strongest = blink.iter().max_by(|a, b| a.1.length().total_cmp(&b.1.length())).unwrap();
    assert!(source.positions[strongest.0 as usize].x > 0.0 && strongest.1.y < 0.0);
}

#[test]
fn targets_move_the_fraction_that_was_asked_for() {
    for (sparsity, targets) in [(0.02, 52), (0.12, 72), (0.25, 120), (0.5, 52), (0.9, 60), (1.0, 80)] {
        let source = head(&desc(6000, targets, sparsity));
        let mesh = source.kept(Tolerance { normal: 1e9, ..Default::default() }).unwrap();
        let moved: usize = mesh.targets.iter().map(|t| t.vertices.len()).sum();
        let mean = moved as f32 / (6000 * targets) as f32;
        let most = if sparsity == 1.0 { 1e-6 } else { 0.2 };
        assert!((mean / sparsity - 1.0).abs() < most, "{mean} for {sparsity}");
        let largest = mesh.targets.iter().map(|t| t.vertices.len()).max().unwrap();
        assert!(sparsity > 0.4 || largest as f32 > mean * 6000.0 * 1.5, "all supports are alike");
    }
}

#[test]
fn values_out_of_range_are_clamped() {
    for sparsity in [-1.0, 0.0, f32::NAN, 7.0, f32::INFINITY] {
        let source = head(&desc(0, 2, sparsity));
        assert_eq!((source.positions.len(), source.targets.len()), (5, 2));
        assert!(source.kept(Tolerance::default()).is_ok());
    }
    for fps in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert_eq!(head_clip(&desc(9, 2, 0.1), 3, fps).fps, 30.0);
    }
    assert_eq!(head_clip(&desc(9, 0, 0.1), 3, 30.0).frame_count(), 0);
    assert_eq!(head_clip(&desc(9, 5, 0.1), 0, 30.0).frame_count(), 0);
}
