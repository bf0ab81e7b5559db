//! Packing a mesh into blocks.

use super::derive::WORDS_MAX;
use super::{BLOCK_SIZES, BlockDesc, BlockIndex, Parts};
use crate::error::{Error, Result};
use crate::math::angle_degrees;
use crate::mesh::MorphMesh;
use crate::pack::formats::{BlockFormat, INTEGER_BITS, Lane};
use crate::pack::order::{inverse, keep_welded, order};
use crate::pack::{
    POSE_FLOATS, PackDesc, PackError, PackedLayout, PackedMesh, PackedTarget, VERTEX_PADDING, base_words,
};
use glam::Vec3;
use std::sync::Arc;

/// The smallest step that lets the largest position (0) or normal (1) component of `mesh` fit its bits in a record.
fn least_step(mesh: &MorphMesh, half: usize) -> f64 {
    let deltas = mesh.targets.iter().flat_map(|t| if half == 0 { &t.positions } else { &t.normals });
    let largest = deltas.map(|d| d.abs().max_element()).fold(0.0, f32::max);
    f64::from(largest) / f64::from((1u32 << (INTEGER_BITS[half] - 1)) - 1)
}

/// The steps for the errors allowed: rounding to nearest is off by up to half the diagonal of a cell.
fn steps(mesh: &MorphMesh, desc: &BlockDesc, format: &dyn BlockFormat) -> [f32; 2] {
    // A mesh without extent has no diagonal to measure by.
    let scale = match mesh.diagonal {
        d if d > 0.0 => f64::from(d),
        _ => (least_step(mesh, 0) * f64::from(1u32 << INTEGER_BITS[0])).max(1e-30),
    };
    let cell = 2.0 / 3f64.sqrt();
    let wanted =
        [cell * f64::from(desc.position_error) * scale, cell * f64::from(desc.normal_error_degrees).to_radians().sin()];
    format.steps(wanted, [0, 1].map(|half| least_step(mesh, half)))
}

fn check(desc: &BlockDesc) -> Result<()> {
    if let Some(size) = desc.size.filter(|s| !BLOCK_SIZES.contains(s)) {
        return Err(Error::invalid(format!("blocks of {size} vertices"), "use 32, 64 or 128"));
    }
    let positive = |v: f32| v.is_finite() && v > 0.0;
    if !positive(desc.position_error) || !positive(desc.normal_error_degrees) || !positive(desc.weight_max) {
        return Err(Error::invalid(
            format!(
                "packing errors of {} of the diagonal and {}°, with weights up to {}",
                desc.position_error, desc.normal_error_degrees, desc.weight_max
            ),
            "use numbers above 0",
        ));
    }
    Ok(())
}

/// Lay out `mesh` in blocks.
pub(in crate::pack) fn pack(mesh: &MorphMesh, desc: &PackDesc, format: &'static dyn BlockFormat) -> Result<PackedMesh> {
    check(&desc.blocks)?;
    let size = desc.blocks.size.unwrap_or(format.default_size());
    let mut steps = steps(mesh, &desc.blocks, format);
    // Two halvings at most.
    let normal_floor = steps[1] / 4.0;
    let mut packed = pack_with(mesh, desc, format, size, steps)?;
    if format.refines() {
        // Where a target turns a short normal, the same rounding is a larger angle: finer steps then, as far as the
        // bits of a record go.
        let allowed = f64::from(desc.blocks.normal_error_degrees);
        let finest = least_step(mesh, 1);
        let error = |packed: &PackedMesh| packed.layout.blocks.as_ref().map_or(0.0, |b| b.error.normal_degrees);
        while error(&packed) > allowed && f64::from(steps[1]) / 2.0 >= finest && steps[1] > normal_floor {
            steps[1] /= 2.0;
            packed = pack_with(mesh, desc, format, size, steps)?;
        }
    }
    Ok(packed)
}

/// Lay out `mesh` in blocks of `size` on a grid of these steps.
fn pack_with(
    mesh: &MorphMesh,
    desc: &PackDesc,
    format: &'static dyn BlockFormat,
    size: u32,
    steps: [f32; 2],
) -> Result<PackedMesh> {
    let error_degrees = f64::from(desc.blocks.normal_error_degrees);
    let diagonal = f64::from(mesh.diagonal);
    let allowed = [
        f64::from(desc.blocks.position_error) * diagonal,
        f64::from(desc.blocks.normal_error_degrees).to_radians().sin(),
    ];

    // What each target keeps: exact deltas, zeroed where they may be dropped.
    let keep = |v: u32, p: Vec3, n: Vec3| -> Option<[f32; POSE_FLOATS]> {
        let (mut p, mut n) = (p, n);
        if desc.format.has_integers() {
            if p.as_dvec3().length() <= allowed[0] {
                p = Vec3::ZERO;
            }
            // As an angle and as a length: normals that files state need not have unit length.
            let (base, delta) = (mesh.normals[v as usize].as_dvec3(), n.as_dvec3());
            if delta.length() <= allowed[1] && angle_degrees(base, base + delta) <= error_degrees {
                n = Vec3::ZERO;
            }
        }
        (p != Vec3::ZERO || n != Vec3::ZERO).then_some([p.x, p.y, p.z, n.x, n.y, n.z])
    };
    type Kept = Vec<Lane>;
    let kept: Vec<Kept> = mesh
        .targets
        .iter()
        .map(|t| {
            let deltas = t.vertices.iter().zip(t.positions.iter().zip(&t.normals));
            deltas.filter_map(|(&v, (&p, &n))| keep(v, p, n).map(|d| (v, d))).collect()
        })
        .collect();
    let members: Vec<Vec<u32>> = kept.iter().map(|t| t.iter().map(|(v, _)| *v).collect()).collect();
    let order = keep_welded(order(mesh.vertex_count(), &members), &mesh.welds, size as usize);
    let packed = inverse(&order);
    drop(members);

    let padded = order.len().next_multiple_of((size as usize).max(VERTEX_PADDING));
    // Entries: by block, then target; a cell of the table lists the deltas of one entry.
    let mut by_block: Vec<Vec<(u32, Kept)>> = vec![vec![]; padded / size as usize];
    for (t, deltas) in kept.into_iter().enumerate() {
        let mut deltas: Kept = deltas.into_iter().map(|(v, d)| (packed[v as usize], d)).collect();
        deltas.sort_unstable_by_key(|(at, _)| *at);
        for run in deltas.chunk_by(|a, b| a.0 / size == b.0 / size) {
            let lanes = run.iter().map(|(at, d)| (at % size, *d)).collect();
            by_block[(run[0].0 / size) as usize].push((t as u32, lanes));
        }
    }
    let (mut first_entry, mut entry_target) = (vec![0u32], vec![]);
    let (mut headers, mut deltas) = (vec![], vec![]);
    for block in &by_block {
        for (target, lanes) in block {
            entry_target.push(*target);
            format.encode(size as usize, steps, lanes, &mut headers, &mut deltas);
        }
        first_entry.push(entry_target.len() as u32);
    }
    headers.resize(headers.len().next_multiple_of(4), 0);
    let words = headers.len() as u64 + deltas.len() as u64;
    if words > WORDS_MAX {
        return Err(Error::invalid(
            format!("mesh '{}': its deltas take {} bytes", mesh.name, words * 4),
            "split the mesh, or use a smaller format",
        ));
    }
    headers.append(&mut deltas);
    let words = headers;
    let base = base_words(mesh, padded, Some(&order));
    let parts = Parts {
        format,
        size,
        order,
        position_step: steps[0],
        normal_step: steps[1],
        weight_max: desc.blocks.weight_max,
        error: PackError::default(),
        first_entry,
        entry_target,
    };
    let targets = mesh.targets.len();
    let mut index = BlockIndex::new(parts, targets, &words, &base).map_err(|what| {
        Error::invalid(format!("mesh '{}' cannot be packed: {what}", mesh.name), "report this with the mesh")
    })?;
    let layout = |index: &BlockIndex| PackedLayout {
        name: mesh.name.clone(),
        format: desc.format,
        vertex_count: mesh.vertex_count(),
        chunk_vertices: padded,
        diagonal: mesh.diagonal,
        targets: mesh.targets.iter().map(|t| target(&t.name, steps)).collect(),
        blocks: Some(Arc::new(index.clone())),
    };
    let packed = PackedMesh { layout: layout(&index), base, words };
    index.error = packed.measure_error(mesh);
    Ok(PackedMesh { layout: layout(&index), ..packed })
}

/// A target of a mesh in blocks.
pub(in crate::pack) fn target(name: &str, steps: [f32; 2]) -> PackedTarget {
    // Both are powers of two.
    let normal_exponent = (steps[1] / steps[0]).log2().clamp(-100.0, 100.0) as i8;
    PackedTarget { name: name.to_owned(), position_step: steps[0], normal_exponent }
}
