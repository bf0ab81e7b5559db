//! The output of `lod` in words.

use super::order::{Agreement, Ranked};
use super::{Lod, Point};
use crate::table::{Column, Table, sig3};

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
    ];
    let metric = &lod.order.metric;
    let ranking = Table::of(&lod.order.ranking, 1, ranking);
    let curve = Table::of(&lod.curve, 1, curve);
    format!("targets by {metric}, the most important first:\n{ranking}\n\nerrors over {measured}:\n{curve}")
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
    ];
    let pairs: &[Column<'_, Agreement>] = &[
        ("metrics", &|a| a.metrics.join(", ")),
        ("Kendall", &|a| format!("{:.2}", a.kendall)),
        ("Spearman", &|a| format!("{:.2}", a.spearman)),
    ];
    let halves = Table::of(&half, 1, halves);
    let pairs = Table::of(agreement, 1, pairs);
    format!("half of the targets kept, errors over {measured}:\n{halves}\n\nagreement of orders:\n{pairs}")
}
