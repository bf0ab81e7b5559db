//! The output of `lod` in words.

use super::{Lod, Point, Ranked};
use crate::table::{Column, Table, sig3};

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
        ("ratio", &|p| sig3(p.error_rel / p.error_random_rel)),
        ("error of vertices", &|p| sig3(p.vertex_rel)),
    ];
    let metric = &lod.metric;
    let ranking = Table::of(&lod.ranking, 1, ranking);
    let curve = Table::of(&lod.curve, 1, curve);
    format!("targets by {metric}, the most important first:\n{ranking}\n\nerrors over {measured}:\n{curve}")
}
