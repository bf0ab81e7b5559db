//! Packing a mesh into blocks.

use super::derive::WORDS_MAX;
use super::{BLOCK_SIZES, BlockDesc, BlockIndex, Parts};
use crate::error::{Error, Result};
use crate::math::{angle_degrees, power_of_two_below};
use crate::mesh::MorphMesh;
use crate::pack::entry::{BitWriter, FAST_BITS, SMALL_BITS, fast_encode, pack_widths, width};
use crate::pack::order::{inverse, keep_welded, order};
use crate::pack::{
    DeltaFormat, POSE_FLOATS, PackDesc, PackError, PackedLayout, PackedMesh, PackedTarget, VERTEX_PADDING, base_words,
};
use glam::Vec3;
use std::sync::Arc;

/// A delta as the kernels will see it.
type Delta = [i32; POSE_FLOATS];

/// The smallest step that lets the largest position (0) or normal (1) component of `mesh` fit its bits in a record.
fn least_step(mesh: &MorphMesh, half: usize) -> f64 {
    let deltas = mesh.targets.iter().flat_map(|t| if half == 0 { &t.positions } else { &t.normals });
    let largest = deltas.map(|d| d.abs().max_element()).fold(0.0, f32::max);
    f64::from(largest) / f64::from((1u32 << (SMALL_BITS[half] - 1)) - 1)
}

/// The steps for the errors allowed: rounding to nearest is off by up to half the diagonal of a cell.
fn steps(mesh: &MorphMesh, desc: &BlockDesc) -> [f32; 2] {
    // A mesh without extent has no diagonal to measure by.
    let scale = match mesh.diagonal {
        d if d > 0.0 => f64::from(d),
        _ => (least_step(mesh, 0) * f64::from(1u32 << SMALL_BITS[0])).max(1e-30),
    };
    let cell = 2.0 / 3f64.sqrt();
    let wanted =
        [cell * f64::from(desc.position_error) * scale, cell * f64::from(desc.normal_error_degrees).to_radians().sin()];
    // Rounding down to a power of two halves a step at most.
    [0, 1].map(|half| power_of_two_below(wanted[half].max(2.0 * least_step(mesh, half))))
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
pub(in crate::pack) fn pack(mesh: &MorphMesh, desc: &PackDesc) -> Result<PackedMesh> {
    check(&desc.blocks)?;
    let format = desc.format;
    let default_size = if format == DeltaFormat::Small { 32 } else { 64 };
    let size = desc.blocks.size.unwrap_or(default_size);
    let mut steps = if format == DeltaFormat::BlockFloat32 { [1.0, 1.0] } else { steps(mesh, &desc.blocks) };
    // Two halvings at most.
    let normal_floor = steps[1] / 4.0;
    let mut packed = pack_with(mesh, desc, size, steps)?;
    if format == DeltaFormat::Small {
        // Where a target turns a short normal, the same rounding is a larger angle: finer steps then, as far as the
        // bits of a record go. (The bits of `fast` are given, and mostly all in use.)
        let allowed = f64::from(desc.blocks.normal_error_degrees);
        let finest = least_step(mesh, 1);
        let error = |packed: &PackedMesh| packed.layout.blocks.as_ref().map_or(0.0, |b| b.error.normal_degrees);
        while error(&packed) > allowed && f64::from(steps[1]) / 2.0 >= finest && steps[1] > normal_floor {
            steps[1] /= 2.0;
            packed = pack_with(mesh, desc, size, steps)?;
        }
    }
    Ok(packed)
}

/// Lay out `mesh` in blocks of `size` on a grid of these steps.
fn pack_with(mesh: &MorphMesh, desc: &PackDesc, size: u32, steps: [f32; 2]) -> Result<PackedMesh> {
    let format = desc.format;
    let error_degrees = f64::from(desc.blocks.normal_error_degrees);
    let diagonal = f64::from(mesh.diagonal);
    let allowed = [
        f64::from(desc.blocks.position_error) * diagonal,
        f64::from(desc.blocks.normal_error_degrees).to_radians().sin(),
    ];

    // What each target keeps: exact deltas, zeroed where they may be dropped.
    let keep = |v: u32, p: Vec3, n: Vec3| -> Option<[f32; POSE_FLOATS]> {
        let (mut p, mut n) = (p, n);
        if format != DeltaFormat::BlockFloat32 {
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
    type Kept = Vec<(u32, [f32; POSE_FLOATS])>;
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
            encode(format, size as usize, steps, lanes, &mut headers, &mut deltas);
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
        format,
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

/// Append one entry.
fn encode(
    format: DeltaFormat,
    size: usize,
    steps: [f32; 2],
    lanes: &[(u32, [f32; POSE_FLOATS])],
    headers: &mut Vec<u32>,
    deltas: &mut Vec<u32>,
) {
    let quantise = |d: &[f32; POSE_FLOATS], shifts: [u32; 2]| -> Delta {
        std::array::from_fn(|i| {
            let step = f64::from(steps[i / 3]) * f64::from(1u32 << shifts[i / 3]);
            (f64::from(d[i]) / step).round() as i32
        })
    };
    match format {
        DeltaFormat::Fast => {
            let fits = |half: usize, shift: u32| {
                let most = (1 << (FAST_BITS[half] - 1)) - 1;
                let mut components = lanes.iter().flat_map(|(_, d)| &d[3 * half..3 * half + 3]);
                let step = f64::from(steps[half]) * f64::from(1u32 << shift);
                components.all(|v| (f64::from(*v) / step).round().abs() <= f64::from(most))
            };
            let shifts = [0, 1].map(|half| (0..31).find(|&s| fits(half, s)).unwrap_or(31));
            headers.push(shifts[0] | shifts[1] << 8);
            let at = deltas.len();
            deltas.resize(at + size * 9 / 4, 0);
            for (lane, delta) in lanes {
                let lane = *lane as usize;
                let (a, b, c) = fast_encode(quantise(delta, shifts));
                deltas[at + lane] = a;
                deltas[at + size + lane] = b;
                deltas[at + 2 * size + lane / 4] |= u32::from(c) << (8 * (lane % 4));
            }
        }
        DeltaFormat::Small => {
            let mut mask = vec![0u32; size / 32];
            let mut widths = [0u32; POSE_FLOATS];
            let mut kept = vec![];
            for (lane, delta) in lanes {
                let q = quantise(delta, [0, 0]);
                if q != [0; POSE_FLOATS] {
                    mask[*lane as usize / 32] |= 1 << (lane % 32);
                    widths = std::array::from_fn(|i| widths[i].max(width(q[i])));
                    kept.push(q);
                }
            }
            headers.extend([deltas.len() as u32, pack_widths(widths)]);
            headers.append(&mut mask);
            let mut bits = BitWriter::default();
            for q in kept {
                q.iter().zip(widths).for_each(|(v, w)| bits.put(*v, w));
            }
            deltas.append(&mut bits.words);
        }
        _ => {
            let at = deltas.len();
            deltas.resize(at + size * POSE_FLOATS, 0);
            for (lane, delta) in lanes {
                for (c, value) in delta.iter().enumerate() {
                    deltas[at + c * size + *lane as usize] = value.to_bits();
                }
            }
        }
    }
}
