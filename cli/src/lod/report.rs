//! The output of `lod` in words.

use super::order::{Agreement, Ranked};
use super::twins::{Apart, Twins};
use super::{Lod, Point};
use crate::table::{Column, Table, sig3};

fn lips_cell(point: &Point) -> String {
    point.lips_rel.map_or("–".into(), sig3)
}

fn ratio(point: &Point) -> String {
    sig3(point.error_rel / point.error_random_rel)
}

pub fn text(lod: &Lod, measured: &str) -> String {
    let ranking: &[Column<'_, Ranked>] = &[
        ("target", &|r| r.name.clone()),
        ("score", &|r| sig3(r.score)),
        ("pinned", &|r| if r.pinned { "yes".into() } else { String::new() }),
    ];
    let curve: &[Column<'_, Point>] = &[
        ("kept", &|p| p.kept.to_string()),
        ("error", &|p| sig3(p.error_rel)),
        ("random orders", &|p| sig3(p.error_random_rel)),
        ("ratio", &ratio),
        ("error of vertices", &|p| sig3(p.vertex_rel)),
        ("of the lips", &lips_cell),
    ];
    let twins = twins(lod);
    let (ranking, curve) = (Table::of(&lod.order.ranking, ranking), Table::of(&lod.curve, curve));
    let metric = &lod.order.metric;
    format!("targets by {metric}, the most important first:\n{ranking}{twins}\n\nerrors over {measured}:\n{curve}")
}

pub fn text_of_all(lods: &[Lod], agreement: &[Agreement], measured: &str) -> String {
    let half: Vec<(&Lod, &Point)> = lods.iter().filter_map(|l| Some((l, l.curve.get(1)?))).collect();
    let halves: &[Column<'_, (&Lod, &Point)>] = &[
        ("metric", &|(lod, _)| lod.order.metric.clone()),
        ("kept", &|(_, p)| p.kept.to_string()),
        ("error", &|(_, p)| sig3(p.error_rel)),
        ("random orders", &|(_, p)| sig3(p.error_random_rel)),
        ("ratio", &|(_, p)| ratio(p)),
        ("error of vertices", &|(_, p)| sig3(p.vertex_rel)),
        ("of the lips", &|(_, p)| lips_cell(p)),
        ("twins side by side", &|(lod, _)| format!("{} of {}", lod.twins.side_by_side, lod.twins.pairs)),
    ];
    let pairs: &[Column<'_, Agreement>] = &[
        ("metrics", &|a| a.metrics.join(", ")),
        ("Kendall", &|a| format!("{:.2}", a.kendall)),
        ("Spearman", &|a| format!("{:.2}", a.spearman)),
    ];
    let (halves, pairs) = (Table::of(&half, halves), Table::of(agreement, pairs));
    format!("half of the targets kept, errors over {measured}:\n{halves}\n\nagreement of orders:\n{pairs}")
}

/// Describes pairs of mirrored targets; empty if there are none.
fn twins(lod: &Lod) -> String {
    let Twins { pairs, side_by_side, apart } = &lod.twins;
    if *pairs == 0 {
        return String::new();
    }
    let percent = |part: f64| format!("{}%", sig3(100.0 * part));
    let of_pair = |Apart { names: [a, b], between, scores_differ, deltas_differ }: &Apart| {
        let (scores, deltas) = (percent(*scores_differ), percent(*deltas_differ));
        format!("\n  {a}, {b}: {between} between them; scores differ by {scores}, mirrored deltas by {deltas}")
    };
    let apart: String = apart.iter().map(of_pair).collect();
    format!("\n\ntwins, left and right: {side_by_side} of {pairs} pairs are side by side{apart}")
}
