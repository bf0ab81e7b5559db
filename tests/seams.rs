//! Split meshes: what is doubled at a seam in the texture coordinates stays together bit for bit in every pose, and is
//! drawn from one index buffer.

use deltamorph::import::sample::{HeadDesc, head};
use deltamorph::reference::evaluate;
use deltamorph::{
    Accumulate, BLOCK_SIZES, BatchSize, BlockDesc, CpuCrowd, DeltaFormat, MorphMesh, MorphSource, POSE_FLOATS,
    PackDesc, PackedMesh, Tolerance, UpdateDesc, UpdatePath,
};
use glam::{Vec2, Vec3};
use std::sync::Arc;

/// The built-in head with a texture in many charts: every eighth face is one of its own.
fn charts() -> MorphSource {
    let mut source = head(&HeadDesc { vertices: 3000, targets: 40, ..HeadDesc::default() });
    let before = source.texcoords.clone();
    for (face, corners) in source.faces.corners.chunks_mut(3).enumerate().filter(|(face, _)| face % 8 == 0) {
        for corner in corners {
            source.texcoords.push(before[corner.texcoord.unwrap() as usize] + Vec2::splat(1.0 + face as f32));
            corner.texcoord = Some(source.texcoords.len() as u32 - 1);
        }
    }
    source
}

fn split(source: &MorphSource) -> MorphMesh {
    source.split().unwrap().to_mesh(Tolerance::default()).unwrap()
}

/// In every format, and with blocks of every size.
fn pack(mesh: &MorphMesh) -> impl Iterator<Item = Arc<PackedMesh>> {
    let sizes = |format: DeltaFormat| if format.is_blocks() { &BLOCK_SIZES[..] } else { &[64] };
    let all =
        DeltaFormat::ALL.into_iter().flat_map(move |format| sizes(format).iter().map(move |&size| (format, size)));
    all.map(|(format, size)| {
        let blocks = BlockDesc { size: Some(size), ..BlockDesc::default() };
        Arc::new(PackedMesh::pack(mesh, &PackDesc { blocks, ..PackDesc::new(format) }).unwrap())
    })
}

#[test]
fn the_built_in_head_has_a_seam() {
    let source = head(&HeadDesc { targets: 0, ..HeadDesc::default() });
    assert_eq!(source.split().unwrap().positions.len(), source.positions.len() + 245);
}

#[test]
fn doubled_vertices_are_equal_bit_for_bit_in_every_pose() {
    for source in [charts(), head(&HeadDesc { vertices: 3000, targets: 40, ..HeadDesc::default() })] {
        let mesh = split(&source);
        let pairs: Vec<(usize, usize)> = (0..mesh.welds.len()).map(|v| (v, mesh.welds[v] as usize)).collect();
        assert!(pairs.iter().filter(|(v, of)| v != of).count() > 50);
        for packed in pack(&mesh) {
            let what = (packed.layout().format, packed.layout().blocks.as_ref().map(|b| b.size()));
            for (accumulate, error_budget) in [
                (Accumulate::Float { tolerance: 1e-5 }, 0.0),
                (Accumulate::Float { tolerance: 1e-4 }, 0.02),
                (Accumulate::Exact, 0.0),
                (Accumulate::Exact, 0.02),
            ] {
                let desc = UpdateDesc { accumulate, error_budget, ..UpdateDesc::new(UpdatePath::Cpu, BatchSize::All) };
                let Ok(mut crowd) = CpuCrowd::new(packed.clone(), desc, 1, 1) else {
                    // Dense formats have neither integer sums nor budgets, float32 deltas no integers.
                    let exact = accumulate == Accumulate::Exact;
                    let dense = what.1.is_none() && (exact || error_budget > 0.0);
                    assert!(dense || exact && what.0 == DeltaFormat::BlockFloat32, "{what:?} {desc:?}");
                    continue;
                };
                let mut weights = vec![0.0f32; mesh.targets.len()];
                let mut random = 7u64;
                for frame in 0..40 {
                    for _ in 0..1 + frame % 5 {
                        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                        let at = (random >> 33) as usize;
                        weights[at % mesh.targets.len()] =
                            if at.is_multiple_of(7) { 0.0 } else { (at % 1009) as f32 / 1009.0 };
                    }
                    crowd.set_weights(0, &weights).unwrap();
                    crowd.update();
                    let pose = packed.layout().to_user_order(crowd.pose(0).unwrap());
                    let bits = |v: usize| pose[v * POSE_FLOATS..][..POSE_FLOATS].iter().map(|x| x.to_bits());
                    if let Some((v, of)) = pairs.iter().find(|(v, of)| !bits(*v).eq(bits(*of))) {
                        panic!("{what:?} {desc:?}: vertices {v} and {of} part in frame {frame}");
                    }
                }
                let pose = evaluate(&packed, &weights);
                assert!(pairs.iter().all(|(v, of)| pose[v * 6..][..6] == pose[of * 6..][..6]), "{what:?}");
            }
        }
    }
}

#[test]
fn a_mesh_is_drawn_with_texture_coordinates_from_one_index_buffer() {
    let source = charts();
    let fans = |face: &[deltamorph::Corner]| {
        (1..face.len() - 1).flat_map(|i| [face[0], face[i], face[i + 1]]).collect::<Vec<_>>()
    };
    let expected: Vec<(Vec3, Vec2)> = (source.faces.iter().flat_map(fans))
        .map(|c| (source.positions[c.position as usize], source.texcoords[c.texcoord.unwrap() as usize]))
        .collect();
    for (mesh, is_split) in [(split(&source), true), (source.to_mesh(Tolerance::default()).unwrap(), false)] {
        for packed in pack(&mesh) {
            let render = packed.layout().render_vertices(&mesh.faces, &mesh.texcoords).unwrap();
            let pulled = render.pose_vertices.iter().enumerate().filter(|(i, pose)| *i as u32 != **pose).count();
            assert_eq!(pulled == 0, is_split);
            let vertex = |&index: &u32| {
                let pose = render.pose_vertices[index as usize] as usize;
                (Vec3::from_slice(&packed.base()[pose * POSE_FLOATS..]), render.texcoords[index as usize])
            };
            assert_eq!(render.indices.iter().map(vertex).collect::<Vec<_>>(), expected);
        }
    }
    let packed = pack(&split(&source)).next().unwrap();
    assert!(packed.layout().render_vertices(&source.faces, &[]).is_err());
}
