//! Costs and errors of pose formats on a packed mesh, in `info` and `pack`.

use crate::input::{self, Input};
use crate::runner::reaching;
use crate::table::{Column, Table, sig3};
use crate::verify::{Errors, FAR_OFF, float_rounding, scale};
use deltamorph::reference::{compare, evaluate_unpacked};
use deltamorph::{BatchSize, BoundClip, CpuCrowd, CrowdDesc, KeptMesh, PackedMesh, PoseFormat, UpdateDesc, UpdatePath};
use deltamorph_head::Rng;
use glam::DVec3;
use serde::Serialize;
use std::sync::Arc;

/// A pose format on a packed mesh, in the JSON of `info` and `pack`. Fields may be added, never renamed.
#[derive(Clone, Serialize)]
pub struct PoseCost {
    pub name: &'static str,
    /// Bytes of a vertex in each pose buffer.
    pub vertex_bytes: usize,
    /// The unit of fixed-point poses; `None` for others.
    pub grid: Option<Grid>,
    /// Bounds on errors, whatever weights from 0 to 1 are asked for; `None` if it is refused.
    #[serde(flatten)]
    pub most: Option<Errors>,
    /// The largest error of the poses of a [`Sample`], as a fraction of the diagonal; `None` if it is refused.
    pub measured_error_rel: Option<f64>,
    /// The reason if the mesh cannot be updated in it; else `None`.
    pub refused: Option<String>,
}

/// The grid of weights and poses, at the largest weight that `apply` and `play` take by default.
#[derive(Clone, Copy, Serialize)]
pub struct Grid {
    /// Weights are whole multiples of 2^-bits.
    pub weight_bits: u32,
    /// The largest absolute weight.
    pub weight_max: f32,
    /// The largest unit of fixed-point positions along an axis, as a fraction of the diagonal.
    pub position_unit_rel: f64,
    /// Unit of fixed-point normals.
    pub normal_unit: f32,
    /// Most targets that move a vertex.
    pub targets_most: usize,
}

/// Poses that are measured.
pub struct Sample<'a> {
    /// The clips of the input.
    pub clips: Vec<BoundClip>,
    /// Weights, and the source at them.
    poses: Vec<(Vec<f32>, Vec<f64>)>,
    /// What they are, in words.
    what: String,
    pub input: &'a Input,
    /// The largest weight that poses are to hold, if it is stated.
    weight_max: Option<f32>,
}

impl<'a> Sample<'a> {
    /// Frames of the clips of `input`, or a pose of random weights from 0 to 1.
    pub fn new(input: &'a Input, weight_max: Option<f32>) -> Self {
        let clips = input.clips.iter().filter_map(|path| input.unless_bad(input.clip(path, &[])));
        let clips: Vec<BoundClip> = clips.collect();
        let mut weights = input::spread(&clips);
        let what = match weights.len() {
            0 => "at random weights from 0 to 1".to_owned(),
            count => format!("in {count} frames of the clips"),
        };
        if weights.is_empty() {
            let mut rng = Rng::new(input.args.seed, 0);
            weights.push(input.raw.targets.iter().map(|_| rng.range(0.0, 1.0)).collect());
        }
        let pose = |weights: Vec<f32>| {
            let reference = evaluate_unpacked(&input.raw, &weights);
            (weights, reference)
        };
        let poses = weights.into_iter().map(pose).collect();
        Self { clips, poses, what, input, weight_max }
    }

    /// The largest distance of a vertex from where the source has it.
    fn farthest(&self, packed: &Arc<PackedMesh>, desc: UpdateDesc) -> deltamorph::Result<f64> {
        let mut crowd = CpuCrowd::new(packed.clone(), &CrowdDesc::new(desc), 1)?;
        let mut farthest = 0.0f64;
        for (weights, reference) in &self.poses {
            crowd.set_weights(0, weights)?;
            crowd.update();
            farthest = farthest.max(compare(&packed.layout().to_user_order(&crowd.pose(0)?), reference).position);
        }
        Ok(farthest)
    }
}

/// What targets do to a vertex, each at weight 1.
#[derive(Clone, Copy, Default)]
struct Moved {
    targets: usize,
    /// Sum of the lengths of its packed deltas.
    length: f64,
    /// Sum of their errors.
    packing: f64,
}

/// What the targets do to each vertex. Without a `source`, errors are those that the packed mesh states for each
/// target.
fn moved(packed: &PackedMesh, source: Option<&KeptMesh>) -> Vec<Moved> {
    let layout = packed.layout();
    let stated = layout.error().map_or(0.0, |error| error.position);
    let mut all = vec![Moved::default(); layout.vertex_count];
    let [mut deltas, mut errors] = [const { vec![] }; 2];
    for target in 0..layout.targets.len() {
        deltas.clear();
        deltas.resize(layout.vertex_count, DVec3::ZERO);
        packed.for_each_delta(target, |vertex, delta| deltas[vertex] = DVec3::from_slice(&delta));
        errors.clone_from(&deltas);
        if let Some(source) = source {
            let of_source = &source.targets[target];
            let places = of_source.vertices.iter().zip(&of_source.positions);
            places.for_each(|(&vertex, delta)| errors[vertex as usize] -= delta.as_dvec3());
        }
        for (moved, (delta, error)) in all.iter_mut().zip(deltas.iter().zip(&errors)) {
            let moves = *delta != DVec3::ZERO;
            moved.targets += usize::from(moves);
            moved.length += delta.length();
            moved.packing += if source.is_none() && moves { stated } else { error.length() };
        }
    }
    all
}

/// A row for each pose format. `held`: a packed file's own mesh, whose errors are those that it states.
pub fn pose_costs(packed: &Arc<PackedMesh>, held: bool, sample: &Sample<'_>) -> Vec<PoseCost> {
    let layout = packed.layout();
    let vertices = moved(packed, (!held).then_some(&*sample.input.raw));
    let targets_most = vertices.iter().map(|moved| moved.targets).max().unwrap_or(0);
    let scale = scale(layout.diagonal);
    let cost = |format: PoseFormat| {
        let desc = UpdateDesc {
            pose: format,
            weight_max: sample.weight_max,
            ..UpdateDesc::new(UpdatePath::Cpu, BatchSize::All)
        };
        let desc = reaching(desc, sample.input.largest.get(), layout);
        let bounds = || -> deltamorph::Result<_> {
            desc.check_for(layout)?;
            let grid = desc.grid(layout)?;
            let float = if grid.is_some() { 0.0 } else { float_rounding(&desc, packed)? };
            Ok((grid, float))
        };
        let (grid, float, refused) = match bounds() {
            Ok((grid, float)) => (grid, float, None),
            Err(e) => (None, 0.0, Some(e.to_string())),
        };
        let most = |of: &dyn Fn(&Moved) -> f64| vertices.iter().map(of).fold(0.0, f64::max);
        let weights = |moved: &Moved| grid.map_or(0.0, |grid| f64::from(grid.weight_step()) / 2.0 * moved.length);
        let rounding = |moved: &Moved| grid.map_or(float, |grid| grid.position_error(moved.targets).into());
        let whole = most(&|moved| moved.packing + weights(moved) + rounding(moved));
        let errors = Errors::new([whole, most(&|moved| moved.packing), most(&weights), most(&rounding)], scale);
        let grid = grid.map(|grid| Grid {
            weight_bits: grid.weight_bits,
            weight_max: grid.weight_max,
            position_unit_rel: f64::from(grid.units[0]) / scale,
            normal_unit: grid.units[3],
            targets_most,
        });
        let most = refused.is_none().then_some(errors);
        let measured_error_rel = sample.farthest(packed, desc).ok().map(|length| length / scale);
        PoseCost { name: format.name(), vertex_bytes: format.stride(), grid, most, measured_error_rel, refused }
    };
    PoseFormat::ALL.into_iter().map(cost).collect()
}

/// The format of 12 bytes that suits the mesh, with the reason.
fn advice(costs: &[PoseCost]) -> Option<String> {
    let measured = |format: PoseFormat| costs.iter().find(|cost| cost.name == format.name())?.measured_error_rel;
    let once = measured(PoseFormat::Rebuilt16)?;
    Some(match measured(PoseFormat::Fixed16) {
        Some(each) if each <= FAR_OFF.max(once) => {
            format!("fixed16, which only adds changes, with an error of {}", sig3(each))
        }
        Some(each) => format!("rebuilt16, with an error of {} (fixed16: {})", sig3(once), sig3(each)),
        None => format!("rebuilt16, with an error of {} (fixed16 is not possible)", sig3(once)),
    })
}

/// The same as a table.
pub fn pose_table(costs: &[PoseCost], sample: &Sample<'_>) -> String {
    let of_grid = |cost: &PoseCost, show: &dyn Fn(&Grid) -> String| cost.grid.as_ref().map_or("–".into(), show);
    let off = |cost: &PoseCost, part: fn(&Errors) -> f64| cost.most.map_or("–".into(), |most| sig3(part(&most)));
    let columns: &[Column<'_, PoseCost>] = &[
        ("poses", &|cost| cost.name.into()),
        ("bytes/vertex", &|cost| cost.vertex_bytes.to_string()),
        ("measured", &|cost| cost.measured_error_rel.map_or("–".into(), sig3)),
        ("maximum error", &|cost| off(cost, |most| most.max_error_rel)),
        ("packing", &|cost| off(cost, |most| most.packing_error_rel)),
        ("weights", &|cost| off(cost, |most| most.weights_error_rel)),
        ("rounding", &|cost| off(cost, |most| most.rounding_error_rel)),
        ("unit", &|cost| of_grid(cost, &|grid| sig3(grid.position_unit_rel))),
        ("unit of normals", &|cost| of_grid(cost, &|grid| sig3(grid.normal_unit.into()))),
        ("weights up to", &|cost| {
            of_grid(cost, &|grid| format!("{} in steps of 2^-{}", grid.weight_max, grid.weight_bits))
        }),
    ];
    let table = Table::of(costs, 1, columns);
    let refused = costs.iter().filter_map(|cost| Some(format!("\n{}: {}", cost.name, cost.refused.as_ref()?)));
    let refused: String = refused.collect();
    let most = costs.iter().find_map(|cost| cost.grid.as_ref()).map_or(String::new(), |grid| {
        let most = grid.targets_most;
        format!(", and for up to {most} active targets per vertex")
    });
    let advice = advice(costs).map_or(String::new(), |format| format!("\nrecommended 12-byte format: {format}"));
    let what = &sample.what;
    format!(
        "{table}\nunit and errors against the source are fractions of the diagonal; measured {what}; the maximum is for \
         weights from 0 to 1{most}{advice}{refused}"
    )
}
