//! Packing a mesh into blocks.

use super::derive::WORDS_MAX;
use super::{BLOCK_SIZES, BlockDesc, BlockIndex, Parts};
use crate::asset::streams::{Measure, StreamPlace, TRIPLE, TRIPLES};
use crate::error::{Error, Result, ensure};
use crate::math::angle_degrees;
use crate::pack::alike;
use crate::pack::formats::{BlockFormat, INTEGER_BITS, Lane, quantise, small};
use crate::pack::grid::MeshSums;
use crate::pack::order::{inverse, keep_welded, order_groups};
use crate::pack::source::{largest, sort};
use crate::pack::{POSE_FLOATS, PackDesc, PackedGroup, PackedLayout, PackedTarget, PoseError, Source, VERTEX_PADDING};
use glam::{DVec3, Vec3};
use std::sync::Arc;

/// A group's deltas: exact, with those within the error limits set to zero.
struct Kept {
    /// By target, ascending by the user's vertex.
    targets: Vec<Vec<Lane>>,
    /// By triple: the largest absolute number of all deltas.
    largest: [f32; TRIPLES],
}

fn vector(of: &[f32]) -> DVec3 {
    Vec3::from_slice(of).as_dvec3()
}

/// How far the tip of a unit vector is from a direction that it is at this angle to, or any larger one.
fn side(degrees: f64) -> f64 {
    degrees.min(90.0).to_radians().sin()
}

fn kept(source: &Source<'_>, desc: &PackDesc) -> Kept {
    let blocks = &desc.blocks;
    let degrees = f64::from(blocks.normal_error_degrees);
    let length = f64::from(blocks.position_error) * f64::from(source.mesh.diagonal);
    let absolute = f64::from(blocks.absolute_error);
    let mut kept = Kept { targets: vec![], largest: [0.0; TRIPLES] };
    for target in &source.mesh.targets {
        let mut deltas = source.deltas(target);
        let [first, second] = largest(&deltas);
        kept.largest = [kept.largest[0].max(first), kept.largest[1].max(second)];
        for (vertex, delta) in &mut deltas {
            for place in &source.streams {
                let numbers = place.morphing_components();
                let dropped = match place.semantic.measure() {
                    Measure::Length => vector(&delta[numbers.clone()]).length() <= length,
                    // As an angle and as a length: normals in files need not have unit length.
                    Measure::Angle => {
                        let base = vector(&source.base(*vertex as usize)[numbers.clone()]);
                        let delta = vector(&delta[numbers.clone()]);
                        delta.length() <= side(degrees) && angle_degrees(base, base + delta) <= degrees
                    }
                    Measure::Absolute => delta[numbers.clone()].iter().all(|d| f64::from(d.abs()) <= absolute),
                };
                if dropped {
                    delta[numbers].fill(0.0);
                }
            }
        }
        deltas.retain(|(_, delta)| delta.iter().any(|d| *d != 0.0));
        kept.targets.push(deltas);
    }
    kept
}

/// The smallest step with which the largest number of a triple fits its bits.
fn least_step(largest: [f32; TRIPLES], triple: usize) -> f64 {
    f64::from(largest[triple]) / f64::from((1u32 << (INTEGER_BITS[triple] - 1)) - 1)
}

/// The steps for the allowed errors: rounding to nearest is off by at most half the diagonal of a cell.
fn steps(source: &Source<'_>, largest: [f32; TRIPLES], desc: &BlockDesc, format: &dyn BlockFormat) -> [f32; TRIPLES] {
    let least = [0, 1].map(|triple| least_step(largest, triple));
    let cell = 2.0 / 3f64.sqrt();
    let mut wanted = [f64::INFINITY; TRIPLES];
    for place in &source.streams {
        let step = match place.semantic.measure() {
            Measure::Length => {
                // A mesh without extent has no diagonal.
                let scale = match source.mesh.diagonal {
                    d if d > 0.0 => f64::from(d),
                    _ => (least[0] * f64::from(1u32 << INTEGER_BITS[0])).max(1e-30),
                };
                cell * f64::from(desc.position_error) * scale
            }
            Measure::Angle => cell * side(desc.normal_error_degrees.into()),
            Measure::Absolute => 2.0 * f64::from(desc.absolute_error),
        };
        for c in place.morphing_components() {
            wanted[c / TRIPLE] = step.min(wanted[c / TRIPLE]);
        }
    }
    // A triple without streams may have any step.
    format.steps(wanted.map(|step| if step.is_finite() { step } else { 1.0 }), least)
}

fn check(desc: &BlockDesc) -> Result<()> {
    let size = desc.size.unwrap_or(BLOCK_SIZES[0]);
    ensure!(BLOCK_SIZES.contains(&size), format!("blocks of {size} vertices"), "use 32, 64 or 128");
    let positive = |v: f32| v.is_finite() && v > 0.0;
    let errors = [desc.position_error, desc.normal_error_degrees, desc.absolute_error];
    let [length, degrees, absolute] = errors;
    let most = desc.weight_max;
    let what =
        format!("packing errors of {length} of the diagonal, {degrees}° and {absolute}, with weights up to {most}");
    ensure!(errors.into_iter().all(positive) && positive(most), what, "use numbers above 0");
    Ok(())
}

pub fn pack(sources: &[Source<'_>], desc: &PackDesc, format: &dyn BlockFormat) -> Result<Vec<PackedGroup>> {
    check(&desc.blocks)?;
    let size = desc.blocks.size.unwrap_or(format.default_size());
    let kept: Vec<Kept> = sources.iter().map(|source| kept(source, desc)).collect();
    let vertices = |target: &Vec<Lane>| target.iter().map(|(vertex, _)| *vertex).collect();
    let members: Vec<Vec<Vec<u32>>> = kept.iter().map(|group| group.targets.iter().map(vertices).collect()).collect();
    let mesh = sources[0].mesh;
    let steps = |(source, kept): (&Source<'_>, &Kept)| steps(source, kept.largest, &desc.blocks, format);
    let mut order = order_groups(mesh.vertex_count(), &members);
    if format.has_records() {
        let steps: Vec<_> = sources.iter().zip(&kept).map(steps).collect();
        order_alike(&mut order, &kept, &steps, size as usize);
    }
    let order: Arc<[u32]> = keep_welded(order, &mesh.welds, size as usize).into();
    let packed = inverse(&order);
    let cut = cut(&mesh.welds, &packed, size);
    let groups = sources.iter().zip(&kept).map(|(source, kept)| {
        let packing = Packing { source, kept, desc, format, size, order: &order, packed: &packed, cut: &cut };
        packing.refined(steps((source, kept)))
    });
    groups.collect()
}

/// Steps of a group, by triple.
type Steps = [f32; TRIPLES];

/// Rearranges the order of vertices, of all groups and their steps, so that entries of `small` are smaller.
fn order_alike(order: &mut [u32], kept: &[Kept], steps: &[Steps], size: usize) {
    let mut moves = vec![vec![]; order.len()];
    let all = kept.iter().zip(steps).flat_map(|(kept, steps)| kept.targets.iter().map(move |target| (target, steps)));
    for (number, (target, steps)) in all.enumerate() {
        for (vertex, delta) in target {
            let rounded = |c: usize| delta.get(c).map_or(0, |delta| quantise(*delta, f64::from(steps[c / TRIPLE])));
            moves[*vertex as usize].push((number, std::array::from_fn(rounded)));
        }
    }
    alike::regroup(order, &moves, size, |vertices, low, high| small::entry_bits(size, vertices, low, high));
}

/// Whether a vertex is of a welded set that is in several blocks.
fn cut(welds: &[u32], packed: &[u32], size: u32) -> Vec<bool> {
    let mut cut = vec![false; packed.len()];
    for (vertex, first) in welds.iter().enumerate() {
        cut[*first as usize] |= packed[vertex] / size != packed[*first as usize] / size;
    }
    welds.iter().enumerate().for_each(|(vertex, first)| cut[vertex] = cut[*first as usize]);
    cut
}

struct Packing<'a> {
    source: &'a Source<'a>,
    kept: &'a Kept,
    desc: &'a PackDesc,
    format: &'a dyn BlockFormat,
    size: u32,
    /// Packed → user order, and its inverse.
    order: &'a Arc<[u32]>,
    packed: &'a [u32],
    /// Vertices of welded sets that are in several blocks.
    cut: &'a [bool],
}

impl Packing<'_> {
    /// Packs with these steps, or finer ones if angles need them.
    fn refined(&self, mut steps: [f32; TRIPLES]) -> Result<PackedGroup> {
        let mut packed = self.with(steps)?;
        let directions = self.source.streams.iter().find(|s| s.semantic.measure() == Measure::Angle);
        if let Some(place) = directions.filter(|_| self.format.refines()) {
            // A target that rotates a short normal turns rounding into a larger angle: halve the step, at most twice
            // and as far as a record's bits allow.
            let triple = place.first / TRIPLE;
            let allowed = f64::from(self.desc.blocks.normal_error_degrees);
            let floor = steps[triple] / 4.0;
            let finest = least_step(self.kept.largest, triple);
            let error =
                |packed: &PackedGroup| packed.layout.blocks.as_ref().map_or(0.0, |b| b.parts.error.of(place.semantic));
            while error(&packed) > allowed && f64::from(steps[triple]) / 2.0 >= finest && steps[triple] > floor {
                steps[triple] /= 2.0;
                packed = self.with(steps)?;
            }
        }
        Ok(packed)
    }

    /// By how much a delta may be off, by triple. Vertices that are welded round alike: those of one block because
    /// their deltas are equal, others to nearest.
    fn slack(&self, (at, delta): &Lane) -> [f64; TRIPLES] {
        let vertex = self.order[*at as usize] as usize;
        let mut slack = [0.0; TRIPLES];
        for place in self.source.streams.iter().filter(|_| !self.cut[vertex]) {
            slack[place.first / TRIPLE] = match place.semantic.measure() {
                Measure::Length => f64::from(self.desc.blocks.position_error) * f64::from(self.source.mesh.diagonal),
                // As far from the tip of the direction as its side of this angle.
                Measure::Angle => {
                    let base = self.source.base(vertex);
                    let numbers = place.morphing_components();
                    let length = (vector(&base[numbers.clone()]) + vector(&delta[numbers])).length();
                    side(self.desc.blocks.normal_error_degrees.into()) * length.min(1.0)
                }
                Measure::Absolute => 0.0,
            } * (1.0 - 1e-6);
        }
        slack
    }

    fn with(&self, steps: [f32; TRIPLES]) -> Result<PackedGroup> {
        let mesh = self.source.mesh;
        let size = self.size;
        let padded = self.order.len().next_multiple_of((size as usize).max(VERTEX_PADDING));
        let blocks = padded as u32 / size;
        // Block, target and deltas of each entry. Stable sort by block: entries stay ascending by target.
        let mut entries: Vec<(u32, u32, Vec<Lane>)> = vec![];
        for (t, deltas) in self.kept.targets.iter().enumerate() {
            let mut deltas: Vec<Lane> = deltas.iter().map(|(v, d)| (self.packed[*v as usize], *d)).collect();
            sort(&mut deltas);
            for run in deltas.chunk_by(|a, b| a.0 / size == b.0 / size) {
                let mut lanes: Vec<Lane> = run.iter().map(|(at, d)| (at % size, *d)).collect();
                if self.format.has_records() {
                    let slack: Vec<_> = run.iter().map(|lane| self.slack(lane)).collect();
                    small::narrow(steps, &mut lanes, &slack);
                }
                entries.push((run[0].0 / size, t as u32, lanes));
            }
        }
        entries.sort_by_key(|(block, ..)| *block);
        let (mut words, mut deltas) = (vec![], vec![]);
        for (.., lanes) in &entries {
            self.format.encode(size as usize, steps, lanes, [&mut words, &mut deltas]);
        }
        words.resize(words.len().next_multiple_of(4), 0);
        let count = words.len() as u64 + deltas.len() as u64;
        let what = format!("mesh '{}': its deltas take {} bytes", mesh.name, count * 4);
        ensure!(count <= WORDS_MAX, what, "split the mesh, or use a smaller format");
        words.append(&mut deltas);
        let base = self.source.base_pose(padded, Some(self.order));
        let parts = Parts {
            format: self.desc.format,
            size,
            order: self.order.clone(),
            steps,
            weight_max: self.desc.blocks.weight_max,
            error: PoseError::default(),
            first_entry: (0..=blocks).map(|b| entries.partition_point(|(block, ..)| *block < b) as u32).collect(),
            entry_target: entries.iter().map(|(_, target, _)| *target).collect(),
        };
        let streams = self.source.streams.clone();
        let names = mesh.targets.iter().map(|target| target.name.as_str());
        let mut packed = PackedGroup::in_blocks(&mesh.name, mesh.diagonal, names, streams, parts, base, words)
            .map_err(|what| {
                Error::invalid(format!("mesh '{}' cannot be packed: {what}", mesh.name), "report this with the mesh")
            })?;
        packed.layout.origin = mesh.origin;
        let error = packed.measure_error(self.source);
        if let Some(index) = packed.layout.blocks.as_mut().map(Arc::make_mut) {
            index.parts.error = error;
        }
        Ok(packed)
    }
}

impl PackedGroup {
    /// A group in blocks, from its parts; the origin is 0.
    ///
    /// # Errors
    /// A message that names the inconsistent part.
    pub(crate) fn in_blocks<'a>(
        name: &str,
        diagonal: f32,
        targets: impl Iterator<Item = &'a str>,
        streams: Vec<StreamPlace>,
        parts: Parts,
        base: Vec<f32>,
        words: Vec<u32>,
    ) -> Result<Self, String> {
        let [position_step, normal_step] = parts.steps;
        // Both are powers of two.
        let normal_exponent = (normal_step / position_step).log2().clamp(-100.0, 100.0) as i8;
        let target = |name: &str| PackedTarget { name: name.to_owned(), position_step, normal_exponent };
        let targets: Vec<_> = targets.map(target).collect();
        let (index, sums) = BlockIndex::new(parts, targets.len(), &streams, &words, &base)?;
        let mut layout = PackedLayout {
            name: name.to_owned(),
            format: index.parts.format,
            streams,
            vertex_count: index.order().len(),
            chunk_vertices: base.len() / POSE_FLOATS,
            diagonal,
            origin: Vec3::ZERO,
            targets,
            indices: Arc::default(),
            blocks: Some(Arc::new(index)),
            sums: Some(MeshSums::of(sums)),
        };
        layout.take_base(&base);
        Ok(Self { layout, base, words })
    }
}
