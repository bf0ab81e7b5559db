//! The CPU twin of `glsl/crowd.comp`: tests hold the tiles of a crowd, and the bytes they are said to move, against it.
//! The path `cpu` itself updates one block at a time, with masks: main memory is read and written by the byte.

use super::Memory;
use super::blocks::Meter;
use crate::asset::streams::TRIPLE;
use crate::pack::blocks::{BlockIndex, ExactGrid};
use crate::pack::{POSE_FLOATS, PackedGroup};
use crate::update::blocks::{TileItem, Tiles, WorkList, row_words};

/// One workgroup's work: a tile of 2^width instances.
pub(crate) fn run(
    packed: &PackedGroup,
    index: &BlockIndex,
    list: &WorkList,
    (tiles, tile, width): (&Tiles, &TileItem, usize),
    exact: Option<ExactGrid>,
    memory: &mut Memory,
    meter: &mut impl Meter,
) {
    let (instances, floats) = (1usize << width, index.size() * POSE_FLOATS);
    let part = tile.block as usize * floats..(tile.block as usize + 1) * floats;
    let base = &packed.base()[part.clone()];
    let rows = &tiles.rows[tile.first as usize..][..tile.count as usize * row_words(width)];
    meter.moved(4 * (4 + instances + rows.len()));
    // What is added to each instance's block, in integers or input units.
    let mut whole = vec![vec![0i32; floats]; instances];
    let mut added = vec![vec![0f32; floats]; instances];
    let steps = index.steps().map(f64::from);
    for row in rows.chunks_exact(row_words(width)) {
        let entry = row[0] as usize;
        meter.moved(index.costs[entry].bytes as usize);
        index.for_each_lane(packed.deltas(), entry, |lane, delta| {
            for (place, &bits) in row[1..=instances].iter().enumerate() {
                for c in 0..POSE_FLOATS {
                    let at = lane * POSE_FLOATS + c;
                    let product = (bits as i32).wrapping_mul((delta[c] / steps[c / TRIPLE]) as i32);
                    whole[place][at] = whole[place][at].wrapping_add(product);
                    added[place][at] += f32::from_bits(bits) * delta[c] as f32;
                }
            }
        });
    }
    if exact.is_some() {
        meter.moved(4 * floats);
    }
    for place in 0..instances {
        let item = &list.items[tile.items[place] as usize];
        let (instance, rebuilt) = (item.instance as usize, tile.rebuilt >> place & 1 != 0);
        let to = instance * memory.slots + item.destination as usize;
        let pose: Vec<f32> = match exact {
            Some(grid) => {
                let units = index.steps().map(|step| step * grid.weight_step());
                let sums = &mut memory.sums[instance][part.clone()];
                for (sum, added) in sums.iter_mut().zip(&whole[place]) {
                    *sum = if rebuilt { 0i32 } else { *sum }.wrapping_add(*added);
                }
                meter.moved(12 * floats);
                sums.iter()
                    .zip(base)
                    .enumerate()
                    .map(|(i, (s, b))| b + *s as f32 * units[i % POSE_FLOATS / TRIPLE])
                    .collect()
            }
            None => {
                let from = match item.source {
                    None => base,
                    Some(slot) => &memory.poses[instance * memory.slots + slot as usize][part.clone()],
                };
                meter.moved(8 * floats);
                from.iter().zip(&added[place]).map(|(f, a)| f + a).collect()
            }
        };
        memory.poses[to][part.clone()].copy_from_slice(&pose);
    }
}
