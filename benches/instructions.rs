//! One format of the `cpu` path, for `.ci/instructions`, which counts the instructions that its loops execute:
//! `instructions FORMAT POSE VERTICES TARGETS CHANGED FRAMES`, CHANGED of the targets in each frame. The pose `plain` is a
//! plain Rust loop over float32 deltas instead, of all vertices for dense formats and of those that a target moves for
//! block formats.
//!
//! Prints how many deltas (targets changed × vertices that they move, all vertices in dense formats) a frame applies.

use deltamorph::mesh::MorphTarget;
use deltamorph::{BatchSize, CpuCrowd, DeltaFormat, MorphMesh, PackDesc, PackedMesh, PoseFormat, Tolerance};
use deltamorph::{UpdateDesc, UpdatePath};
use deltamorph_head::{HeadDesc, head};
use glam::Vec3;
use std::hint::black_box;
use std::sync::Arc;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [format, pose, numbers @ ..] = &arguments[..] else {
        println!("instructions FORMAT POSE VERTICES TARGETS CHANGED FRAMES; .ci/instructions runs it");
        return;
    };
    let numbers: Vec<usize> = numbers.iter().map(|number| number.parse().expect("a number")).collect();
    let [vertices, targets, changed, frames] = numbers[..] else { panic!("four numbers") };
    let format = DeltaFormat::ALL.into_iter().find(|f| f.name() == format).expect("a delta format");
    let mesh = head(&HeadDesc::default().vertices(vertices).targets(targets));
    let mesh = mesh.to_mesh(Tolerance::default()).expect("the built-in head");
    let frame = |f: usize| (0..changed).map(move |i| ((f * changed + i) % targets, 0.25 + ((f + i) % 8) as f32 / 16.0));
    let moved = |target: usize| match format.is_blocks() {
        true => mesh.targets[target].vertices.len(),
        false => mesh.vertex_count(),
    };
    if pose == "plain" {
        plain(&mesh, format.is_blocks(), (0..frames).map(frame));
    } else {
        let pose = PoseFormat::ALL.into_iter().find(|p| p.name() == pose).expect("a pose format");
        let packed = Arc::new(PackedMesh::pack(&mesh, &PackDesc::new(format)).expect("targets that fit"));
        let desc = UpdateDesc::new(UpdatePath::Cpu, BatchSize::All).pose(pose);
        let mut crowd = CpuCrowd::new(packed, desc, 1, 1).expect("one thread");
        let mut weights = vec![0.125; targets];
        crowd.set_weights(0, &weights).expect("finite weights");
        crowd.update(); // from base
        for f in 0..frames {
            frame(f).for_each(|(target, weight)| weights[target] = weight);
            crowd.set_weights(0, &weights).expect("finite weights");
            assert_eq!(crowd.update().coefficients, changed);
        }
    }
    println!("{}", (0..frames).flat_map(frame).map(|(target, _)| moved(target)).sum::<usize>());
}

/// Adds weighted deltas as a plain program would: of each target an array with three floats of position and three of
/// normal for every vertex, or the indices of the vertices that it moves and eight floats for each.
fn plain<I: Iterator<Item = (usize, f32)>>(mesh: &MorphMesh, sparse: bool, frames: impl Iterator<Item = I>) {
    let vertices = mesh.vertex_count();
    let deltas = |target: &MorphTarget| target.positions.iter().zip(&target.normals).map(|(p, n)| [*p, *n]).collect();
    let moved: Vec<Vec<[Vec3; 2]>> = mesh.targets.iter().map(deltas).collect();
    let dense = |(target, moved): (&MorphTarget, &Vec<[Vec3; 2]>)| {
        let mut all = vec![0.0; vertices * 6];
        for (vertex, [p, n]) in target.vertices.iter().zip(moved) {
            all[*vertex as usize * 6..][..6].copy_from_slice(&[p.x, p.y, p.z, n.x, n.y, n.z]);
        }
        all
    };
    let dense: Vec<Vec<f32>> = mesh.targets.iter().zip(&moved).map(dense).collect();
    let padded = |[p, n]: &[Vec3; 2]| [p.x, p.y, p.z, 0.0, n.x, n.y, n.z, 0.0];
    let padded: Vec<Vec<[f32; 8]>> = moved.iter().map(|moved| moved.iter().map(padded).collect()).collect();
    let (mut pose, mut pose8) = (vec![0.0; vertices * 6], vec![[0.0; 8]; vertices]);
    let mut applied = vec![0.0; mesh.targets.len()];
    for frame in frames {
        let changed: Vec<(usize, f32)> = frame.map(|(t, w)| (t, w - std::mem::replace(&mut applied[t], w))).collect();
        if sparse {
            changed.iter().for_each(|&(t, w)| plain_sparse(&mut pose8, &mesh.targets[t].vertices, &padded[t], w));
        } else {
            for four in changed.chunks_exact(4) {
                plain_dense(
                    &mut pose,
                    std::array::from_fn(|i| &dense[four[i].0][..]),
                    std::array::from_fn(|i| four[i].1),
                );
            }
        }
    }
    black_box((pose, pose8));
}

#[inline(never)]
fn plain_dense(pose: &mut [f32], deltas: [&[f32]; 4], weights: [f32; 4]) {
    widest(
        #[inline(always)]
        || {
            let [a, b, c, d] = deltas.map(|deltas| &deltas[..pose.len()]);
            for (i, p) in pose.iter_mut().enumerate() {
                *p += weights[0] * a[i] + weights[1] * b[i] + weights[2] * c[i] + weights[3] * d[i];
            }
        },
    );
}

#[inline(never)]
fn plain_sparse(pose: &mut [[f32; 8]], vertices: &[u32], deltas: &[[f32; 8]], weight: f32) {
    widest(
        #[inline(always)]
        || {
            for (&vertex, delta) in vertices.iter().zip(deltas) {
                // A copy, so that the compiler makes vectors of it.
                let mut sum = pose[vertex as usize];
                for i in 0..8 {
                    sum[i] += weight * delta[i];
                }
                pose[vertex as usize] = sum;
            }
        },
    );
}

/// As the library does it.
#[inline(always)]
fn widest(f: impl FnOnce()) {
    #[cfg(target_arch = "x86_64")]
    if let Some(avx2) = fearless_simd::Level::new().as_avx2() {
        return fearless_simd::Simd::vectorize(avx2, f);
    }
    f();
}
