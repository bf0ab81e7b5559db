//! Split meshes: vertices doubled at a seam of the texture coordinates stay together bit for bit in every pose, and are
//! drawn from one index buffer.

use crate::prelude::*;
use deltamorph::mesh::{Corner, StreamData, StreamDeltas};
use deltamorph::packed::BLOCK_SIZES;
use glam::{Vec2, Vec3};

/// Makes the built-in head with a texture of many charts: every eighth face is its own chart.
fn charts() -> Mesh {
    let mut source = head(&HeadDesc { vertices: 3000, targets: 40, ..Default::default() });
    let before = source.texcoords.clone();
    for (face, corners) in source.faces.corners.chunks_mut(3).enumerate().filter(|(face, _)| face % 8 == 0) {
        for corner in corners {
            source.texcoords.push(before[corner.texcoord.unwrap() as usize] + Vec2::splat(1.0 + face as f32));
            corner.texcoord = Some(source.texcoords.len() as u32 - 1);
        }
    }
    source
}

fn split(source: &Mesh) -> KeptMesh {
    source.split().unwrap().kept(Tolerance::default()).unwrap()
}

/// Adds tangents, which move with the positions.
fn with_tangents(mut source: Mesh) -> Mesh {
    let tangent = |p: &Vec3| Vec3::Y.cross(*p).try_normalize().unwrap_or(Vec3::X).extend(1.0).to_array();
    let values = source.positions.iter().flat_map(tangent).collect();
    source.streams = vec![StreamData { semantic: Semantic::Tangent, values }];
    for target in &mut source.targets {
        let vertices = target.positions.iter().map(|(v, _)| *v).collect();
        let deltas = target.positions.iter().flat_map(|(_, d)| (*d * 0.3).to_array()).collect();
        target.streams = vec![StreamDeltas { vertices, deltas }];
    }
    source
}

/// Returns the corners of all triangles, as stated by the faces.
fn corners(source: &Mesh) -> Vec<Corner> {
    let fan = |face: &[Corner]| (1..face.len() - 1).flat_map(|i| [face[0], face[i], face[i + 1]]).collect::<Vec<_>>();
    source.faces.iter().flat_map(fan).collect()
}

/// Returns doubled vertices, and their originals.
fn doubled(mesh: &KeptMesh) -> Vec<(usize, usize)> {
    let pairs: Vec<(usize, usize)> =
        (0..).zip(&mesh.welds).map(|(v, &of)| (v, of as usize)).filter(|(v, of)| v != of).collect();
    assert!(pairs.len() > 50);
    pairs
}

/// Returns the first of `pairs` that is not equal bit for bit in `pose`.
fn parted(pose: &[f32], pairs: &[(usize, usize)]) -> Option<(usize, usize)> {
    let bits = |v: usize| pose[v * POSE_FLOATS..][..POSE_FLOATS].iter().map(|x| x.to_bits());
    pairs.iter().copied().find(|(v, of)| !bits(*v).eq(bits(*of)))
}

/// Packs in every format, and with blocks of every size.
fn pack(mesh: &KeptMesh) -> impl Iterator<Item = Arc<PackedMesh>> {
    let sizes = |format: DeltaFormat| if format.is_blocks() { &BLOCK_SIZES[..] } else { &[64] };
    let all =
        DeltaFormat::ALL.into_iter().flat_map(move |format| sizes(format).iter().map(move |&size| (format, size)));
    all.map(|(format, size)| {
        let blocks = BlockDesc { size: Some(size), ..Default::default() };
        Arc::new(PackedMesh::pack(mesh, &PackDesc { blocks, ..PackDesc::new(format) }).unwrap())
    })
}

#[test]
fn doubled_vertices_are_equal_bit_for_bit_in_every_pose() {
    let mesh = split(&charts());
    let pairs = doubled(&mesh);
    for packed in pack(&mesh) {
        let what = (packed.layout().format, packed.layout().blocks.as_ref().map(|b| b.size()));
        for (pose, error_budget) in PoseFormat::ALL.into_iter().flat_map(|pose| [(pose, 0.0), (pose, 0.02)]) {
            let tolerance = if error_budget > 0.0 { 1e-4 } else { 1e-5 };
            let desc = UpdateDesc { pose, tolerance, ..UpdateDesc::new(UpdatePath::Cpu, BatchSize::All) };
            let desc = UpdateDesc { error_budget, weight_max: Some(2.0), ..desc };
            let Ok(mut crowd) = CpuCrowd::new(packed.clone(), &CrowdDesc::new(desc), 1) else {
                // Dense formats have no budgets, float32 deltas no fixed-point poses, dense ones none that are rounded
                // once.
                let dense = what.1.is_none() && error_budget > 0.0;
                assert!(dense || !pose.takes(what.0), "{what:?} {desc:?}");
                continue;
            };
            for frame in 0..30 {
                crowd.set_weights(0, &gpu::weights(&packed, frame, 11)).unwrap();
                crowd.update();
                let pose = packed.layout().to_user_order(&crowd.pose(0).unwrap());
                assert_eq!(parted(&pose, &pairs), None, "{what:?} {desc:?}, frame {frame}");
            }
        }
        let pose = evaluate(&packed, &gpu::weights(&packed, 1, 5));
        assert!(pairs.iter().all(|(v, of)| pose[v * 6..][..6] == pose[of * 6..][..6]), "{what:?}");
    }
}

#[test]
fn a_mesh_is_drawn_with_texture_coordinates_from_one_index_buffer() {
    let source = charts();
    let expected: Vec<(Vec3, Vec2)> = (corners(&source).into_iter())
        .map(|c| (source.positions[c.position as usize], source.texcoords[c.texcoord.unwrap() as usize]))
        .collect();
    for (mesh, is_split) in [(split(&source), true), (source.kept(Tolerance::default()).unwrap(), false)] {
        for packed in pack(&mesh) {
            let render = packed.render_vertices().unwrap();
            let pulled = render.pose_vertices.iter().enumerate().filter(|(i, pose)| *i as u32 != **pose).count();
            assert_eq!(pulled == 0, is_split);
            let vertex = |&index: &u32| {
                let pose = render.pose_vertices[index as usize] as usize;
                (Vec3::from_slice(&packed.base()[pose * POSE_FLOATS..]), render.texcoords[index as usize])
            };
            assert_eq!(render.indices.iter().map(vertex).collect::<Vec<_>>(), expected);
        }
    }
    let mut packed = PackedMesh::clone(&pack(&split(&source)).next().unwrap());
    packed.texcoords.clear();
    assert!(packed.render_vertices().is_err());
}

#[test]
fn doubled_vertices_are_equal_bit_for_bit_in_every_pose_of_the_gpu() {
    let mesh = split(&with_tangents(charts()));
    let pairs = doubled(&mesh);
    for driver in gpu::drivers() {
        gpu::on_device(&driver, false, |headless, engine| {
            for format in DeltaFormat::ALL {
                let packed = gpu::packed(engine, &mesh, format);
                assert_eq!(packed.groups().len(), 2);
                for update in updates(headless, format) {
                    let mut crowd = HeadlessCrowd::new(headless, &packed, &CrowdDesc::new(update)).unwrap();
                    for frame in 0..30 {
                        crowd.step(&[&gpu::weights(&packed, frame, 11)]).unwrap();
                        for group in 0..packed.groups().len() {
                            let (pose, _) = crowd.read_group(0, group).unwrap();
                            let parted = parted(&pose, &pairs);
                            assert_eq!(parted, None, "{driver} {format:?} {update:?}: group {group}, frame {frame}");
                        }
                    }
                }
            }
        });
    }
}

/// Returns the paths of a device, block formats with each pose format, and with error budgets.
fn updates(headless: &Headless, format: DeltaFormat) -> Vec<UpdateDesc> {
    if format.is_blocks() {
        let updates = gpu::update_descs(headless.engine(), format);
        return updates.iter().flat_map(|&u| [u, UpdateDesc { error_budget: 0.02, ..u }]).collect();
    }
    let paths = [UpdatePath::Compute, UpdatePath::Feedback];
    let there = paths.into_iter().filter(|path| headless.caps().check_path(*path).is_ok());
    there.map(|path| UpdateDesc::new(path, BatchSize::Targets(3))).collect()
}
