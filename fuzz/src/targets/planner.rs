//! Any small mesh and any history of a crowd on the CPU: poses agree with the float64 reference, previous poses are the
//! poses before, and fixed-point poses are bit for bit those of a new crowd.

use crate::{Memory, Target, bounded, check_error, check_pose};
use arbitrary::{Result, Unstructured};
use deltamorph::packed::BLOCK_SIZES;
use deltamorph::{
    BatchSize, BlockDesc, CpuCrowd, CrowdDesc, DeltaFormat, KeptMesh, Mesh, MeshArrays, PackDesc, PackedMesh,
    PoseFormat, TargetArrays, Tolerance, UpdateDesc, UpdateMode, UpdatePath,
};
use std::sync::Arc;

pub const TARGET: Target = Target { name: "planner", run, mutate: |_, _| None, seeds: Vec::new };

fn run(data: &[u8]) {
    // The mesh has at most 200 vertices and 8 targets, the crowd 4 instances, however long the input.
    bounded("a crowd", data.len(), Memory { base: 8 << 20, per_byte: 0 }, || _ = history(&mut Unstructured::new(data)));
}

/// Chooses a number as meshes have it: most are small and round.
fn number(u: &mut Unstructured<'_>) -> Result<f32> {
    Ok(match u.int_in_range(0..=7u8)? {
        0 => 0.0,
        1..=3 => f32::from(u.arbitrary::<i8>()?) / 16.0,
        4 | 5 => f32::from(u.arbitrary::<i16>()?) / 256.0,
        6 => f32::from(u.arbitrary::<i16>()?) * 1e-7,
        _ => Some(f32::from_bits(u.arbitrary()?)).filter(|x| x.abs() < 1e6).unwrap_or(1.0),
    })
}

/// Chooses vectors, with repetitions, so that short inputs have many; zero where `every` does not divide their number.
fn vectors(u: &mut Unstructured<'_>, count: usize, every: usize) -> Result<Vec<[f32; 3]>> {
    let first = u.int_in_range(0..=count)?;
    let values: Vec<[f32; 3]> =
        (0..u.int_in_range(1..=6usize)?).map(|_| Ok([number(u)?, number(u)?, number(u)?])).collect::<Result<_>>()?;
    let of =
        |v: usize| if every > 1 && v < first || !v.is_multiple_of(every) { [0.0; 3] } else { values[v % values.len()] };
    Ok((0..count).map(of).collect())
}

fn mesh(u: &mut Unstructured<'_>) -> Result<deltamorph::Result<KeptMesh>> {
    let vertices = u.int_in_range(1..=200usize)?;
    let mut positions = vectors(u, vertices, 1)?;
    positions.iter_mut().enumerate().for_each(|(v, position)| position[0] += v as f32 / 8.0);
    let mut deltas = vec![];
    for _ in 0..u.int_in_range(0..=8u8)? {
        let every = u.int_in_range(1..=7)?;
        deltas.push([vectors(u, vertices, every)?, if u.arbitrary()? { vectors(u, vertices, every)? } else { vec![] }]);
    }
    let names: Vec<String> = (0..deltas.len()).map(|target| format!("target {target}")).collect();
    let tangents = vec![[1.0, 0.0, 0.0, -1.0]; if u.arbitrary()? { vertices } else { 0 }];
    let mut targets = vec![];
    for (name, [positions, normals]) in names.iter().zip(&deltas) {
        let tangents = if tangents.is_empty() { &[][..] } else { positions };
        targets.push(TargetArrays { name, positions, normals, tangents });
    }
    let indices: Vec<u32> = (0..vertices.saturating_sub(2) as u32).flat_map(|v| [v, v + 1, v + 2]).collect();
    let normals = vec![[0.0, 0.6, 0.8]; vertices];
    let arrays = MeshArrays {
        name: "mesh",
        positions: &positions,
        normals: &normals,
        tangents: &tangents,
        indices: &indices,
        targets: &targets,
        ..Default::default()
    };
    Ok(Mesh::from_arrays(&arrays).and_then(|source| source.kept(Tolerance::ZERO)))
}

/// The expected state of an instance.
#[derive(Clone, Default)]
struct Known {
    present: bool,
    hidden: bool,
    weights: Vec<f32>,
    pose: Option<Vec<f32>>,
    /// Whether the next pose has no predecessor.
    cut: bool,
    budget: f32,
    /// The largest sum so far, for the rounding of dense float32 poses.
    reached: f64,
}

fn history(u: &mut Unstructured<'_>) -> Result<()> {
    let refused = |error| {
        check_error(error);
        Ok(())
    };
    let mesh = match mesh(u)? {
        Ok(mesh) => mesh,
        Err(error) => return refused(error),
    };
    let format = *u.choose(&DeltaFormat::ALL)?;
    let sizes = [None, Some(BLOCK_SIZES[0]), Some(BLOCK_SIZES[1]), Some(BLOCK_SIZES[2])];
    let mut pack =
        PackDesc { blocks: BlockDesc { size: *u.choose(&sizes)?, ..Default::default() }, ..PackDesc::new(format) };
    if u.arbitrary()? {
        // Several chunks.
        pack.max_chunk_bytes = 64 * 24 * 2 * mesh.targets.len().max(1) as u64;
    }
    let packed = match PackedMesh::pack(&mesh, &pack) {
        Ok(packed) => Arc::new(packed),
        Err(error) => return refused(error),
    };
    let batch =
        if format.is_blocks() || u.arbitrary()? { BatchSize::All } else { BatchSize::Targets(u.int_in_range(1..=5)?) };
    let budget = if format.is_blocks() && u.arbitrary()? { number(u)?.abs() } else { 0.0 };
    let desc = UpdateDesc {
        mode: *u.choose(&[UpdateMode::Incremental, UpdateMode::Rebuild])?,
        slots: u.int_in_range(1..=4)?,
        pose: *u.choose(&PoseFormat::ALL)?,
        tolerance: *u.choose(&[1e-5, 1e-4, 1e-6, 0.5])?,
        weight_max: *u.choose(&[None, Some(1.0), Some(2.5), Some(0.1), Some(100.0)])?,
        error_budget: budget,
        ..UpdateDesc::new(UpdatePath::Cpu, batch)
    };
    let count = u.int_in_range(1..=4u32)?;
    let new = || CpuCrowd::new(packed.clone(), &CrowdDesc { instances: count, ..CrowdDesc::new(desc) }, 1);
    let mut crowd = match new() {
        Ok(crowd) => crowd,
        Err(error) => return refused(error),
    };
    let most = desc.grid(packed.layout()).expect("there is a crowd").map_or(4.0, |grid| grid.weight_max);
    let fresh = Known { present: true, weights: vec![0.0; mesh.targets.len()], budget, ..Known::default() };
    let mut known = vec![fresh.clone(); count as usize];
    for _ in 0..60 {
        if u.is_empty() {
            break;
        }
        let i = u.int_in_range(0..=count - 1)?;
        let one = &mut known[i as usize];
        match u.int_in_range(0..=15u8)? {
            0..=3 => {
                let mut weights = one.weights.clone();
                for weight in &mut weights {
                    if u.arbitrary()? {
                        *weight = *u.choose(&[0.0, most, -most, most / 3.0, most * 1e-6])?
                            * f32::from(u.arbitrary::<u8>()?)
                            / 255.0;
                    }
                }
                let done = crowd.set_weights(i, &weights);
                assert_eq!(done.is_ok(), one.present, "{done:?}");
                if one.present {
                    one.weights = weights;
                }
            }
            4 => {
                assert_eq!(crowd.reset_history(i).is_ok(), one.present);
                one.cut = true;
            }
            5 => {
                let hidden = u.arbitrary()?;
                assert_eq!(crowd.set_hidden(i, hidden).is_ok(), one.present);
                if one.present {
                    (one.cut, one.hidden) = (one.cut | (one.hidden != hidden), hidden);
                }
            }
            6 => {
                assert_eq!(crowd.remove(i).is_ok(), one.present);
                one.present = false;
            }
            7 => {
                let free = known.iter().position(|one| !one.present);
                assert_eq!(crowd.add().ok().map(|added| added as usize), free);
                if let Some(free) = free {
                    // Whether the instance keeps the budget of its predecessor is not checked here.
                    let budget = budget.max(known[free].budget);
                    known[free] = Known { budget, ..fresh.clone() };
                }
            }
            8 => {
                let new = if u.arbitrary()? { budget / 2.0 } else { budget };
                if crowd.set_error_budget(i, new).is_ok() {
                    one.budget = new;
                }
            }
            _ => {
                update(&packed, &desc, &mut crowd, &mut known);
                if desc.grid(packed.layout()).is_ok_and(|grid| grid.is_some()) && budget == 0.0 {
                    same_as_anew(new().expect("as before"), &crowd, &known);
                }
            }
        }
    }
    Ok(())
}

fn update(mesh: &PackedMesh, desc: &UpdateDesc, crowd: &mut CpuCrowd, known: &mut [Known]) {
    let stats = crowd.update();
    assert!(stats.bound.is_finite() && stats.bound >= 0.0, "{stats:?}");
    for (i, one) in (0..).zip(known).filter(|(_, one)| one.present && !one.hidden) {
        let pose = crowd.pose(i).expect("present").into_owned();
        check_pose(mesh, crowd, i, desc, &one.weights, f64::from(stats.bound + one.budget), &mut one.reached);
        match crowd.previous_pose(i).expect("present") {
            Some(previous) => {
                let expected = one.pose.as_ref().filter(|_| !one.cut).unwrap_or(&pose);
                let same = previous.iter().zip(expected).all(|(a, b)| a.to_bits() == b.to_bits());
                assert!(same, "the previous pose of {i}: {desc:?}, {:?}", mesh.layout().format);
            }
            None => assert_eq!(desc.slots, 1),
        }
        (one.pose, one.cut) = (Some(pose), false);
    }
}

/// After any history, fixed-point poses are those of a full evaluation.
fn same_as_anew(mut fresh: CpuCrowd, crowd: &CpuCrowd, known: &[Known]) {
    for (i, one) in (0..).zip(known) {
        fresh.set_weights(i, &one.weights).expect("they were accepted");
    }
    fresh.update();
    for (i, _) in (0..).zip(known).filter(|(_, one)| one.present && !one.hidden) {
        let [a, b] = [&fresh, crowd].map(|crowd| crowd.stored_pose(i, 0).expect("an instance"));
        assert!(a == b, "instance {i} is not what it is in a crowd that was made anew");
    }
}
