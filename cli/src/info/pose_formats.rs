//! Costs and errors of pose formats on a packed mesh, in `info` and `pack`.

use crate::table::{Table, sig3};
use crate::verify::scale;
use deltamorph::{BatchSize, PackedLayout, PoseFormat, UpdateDesc, UpdatePath};
use serde::Serialize;

/// A pose format on a packed mesh, in the JSON of `info` and `pack`. Fields may be added, never renamed.
#[derive(Clone, Debug, Serialize)]
pub struct PoseCost {
    pub name: &'static str,
    /// Bytes of a vertex in each pose buffer.
    pub vertex_bytes: usize,
    /// The unit of fixed-point poses; `None` for others.
    pub grid: Option<Grid>,
    /// The reason if the mesh cannot be updated in it; else `None`.
    pub refused: Option<String>,
}

/// The grid of weights and poses, at the default largest weight.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Grid {
    /// Weights are whole multiples of 2^-bits.
    pub weight_bits: u32,
    /// The largest absolute weight.
    pub weight_max: f32,
    /// Unit of fixed-point positions, in input units and as a fraction of the diagonal.
    pub position_unit: f32,
    pub position_unit_rel: f64,
    /// Unit of fixed-point normals.
    pub normal_unit: f32,
    /// Most targets that touch a block; for dense deltas, that move a vertex.
    pub targets_most: usize,
    /// Largest distance that rounding moves a vertex if all of them are active, in input units and as a fraction of the
    /// diagonal; 0 if poses are not rounded. Errors of packing and of rounding weights are extra.
    pub rounding_error: f32,
    pub rounding_error_rel: f64,
}

/// A row for each pose format.
pub fn pose_costs(layout: &PackedLayout) -> Vec<PoseCost> {
    let (targets_most, scale) = (layout.most_targets(), scale(layout.diagonal));
    let relative = |length: f32| f64::from(length) / scale;
    let cost = |format: PoseFormat| {
        let desc = UpdateDesc::new(UpdatePath::Cpu, BatchSize::All).pose(format);
        let (grid, refused) = match desc.grid(layout) {
            Ok(grid) => (grid, None),
            Err(e) => (None, Some(e.to_string())),
        };
        let grid = grid.map(|grid| Grid {
            weight_bits: grid.weight_bits,
            weight_max: grid.weight_max,
            position_unit: grid.units[0],
            position_unit_rel: relative(grid.units[0]),
            normal_unit: grid.units[1],
            targets_most,
            rounding_error: grid.position_error(targets_most),
            rounding_error_rel: relative(grid.position_error(targets_most)),
        });
        PoseCost { name: format.name(), vertex_bytes: format.stride(), grid, refused }
    };
    PoseFormat::ALL.into_iter().map(cost).collect()
}

/// Rounding with all targets active, as a fraction of the diagonal, above which `rebuilt16` is advised. Clips of four
/// rigs reached 5 to 17% of it.
const ROUNDED_TOO_FAR: f64 = 2e-3;

/// The format of 12 bytes that suits the mesh, with the reason.
fn advice(costs: &[PoseCost]) -> Option<String> {
    let cost = |format: PoseFormat| costs.iter().find(|cost| cost.name == format.name());
    let error = |format| Some(sig3(cost(format)?.grid?.rounding_error_rel));
    let [each, once] = [PoseFormat::Fixed16, PoseFormat::Rebuilt16].map(error);
    let narrow = cost(PoseFormat::Fixed16)?.grid.filter(|grid| grid.rounding_error_rel <= ROUNDED_TOO_FAR);
    Some(match (narrow, each, once?) {
        (Some(_), Some(each), _) => format!("fixed16, which adds only what changes, and is off by {each} at most"),
        (_, Some(each), once) => {
            format!("rebuilt16, which is off by {once} at most, while fixed16 may be off by {each}")
        }
        (_, None, once) => format!("rebuilt16, which is off by {once} at most; fixed16 is refused"),
    })
}

/// The same as a table, next to the error of packing.
pub fn pose_table(costs: &[PoseCost], packing_rel: f64) -> String {
    let headings = ["poses", "bytes/vertex", "unit", "rounding at most", "packing", "normals' unit", "weights up to"];
    let (mut table, mut refused) = (Table::new(&headings, 1), String::new());
    for cost in costs {
        let of_grid = |show: &dyn Fn(&Grid) -> String| cost.grid.as_ref().map_or("–".into(), show);
        table.row([
            cost.name.to_owned(),
            cost.vertex_bytes.to_string(),
            of_grid(&|grid| sig3(grid.position_unit_rel)),
            of_grid(&|grid| sig3(grid.rounding_error_rel)),
            sig3(packing_rel),
            of_grid(&|grid| sig3(grid.normal_unit.into())),
            of_grid(&|grid| format!("{} in steps of 2^-{}", grid.weight_max, grid.weight_bits)),
        ]);
        refused.extend(cost.refused.as_ref().map(|why| format!("\n{}: {why}", cost.name)));
    }
    let most = costs.iter().find_map(|cost| cost.grid.as_ref()).map_or(String::new(), |grid| {
        let most = grid.targets_most;
        format!(
            "\nunit and errors of positions as fractions of the diagonal; rounding with {most} targets active at once, \
                 as many as any vertex has; packing of each target at weight 1"
        )
    });
    let advice = advice(costs).map_or(String::new(), |format| format!("\nin 12 bytes a vertex: {format}"));
    format!("{table}{most}{advice}{refused}")
}
