//! Orders of importance: pins first, then by score; and their agreement.

use deltamorph::lod::{is_pinned, ranked};
use serde::Serialize;

/// A target in an order of importance.
#[derive(Clone, Debug, Serialize)]
pub struct Ranked {
    pub name: String,
    /// In the unit of the metric; higher is more important.
    pub score: f64,
    /// Ranked first, regardless of its score.
    pub pinned: bool,
}

/// Names of targets, the most important first.
#[derive(Clone, Debug, Serialize)]
pub struct Order {
    pub schema: u32,
    pub metric: String,
    pub ranking: Vec<Ranked>,
    /// The same by their numbers in the mesh.
    #[serde(skip)]
    pub targets: Vec<usize>,
}

impl Order {
    /// Ranks targets by score, the largest first, after those that `pins` name; ties keep the order of the mesh.
    pub fn new(metric: &str, names: &[&str], scores: &[f64], pins: &[String]) -> Self {
        let pinned: Vec<bool> = names.iter().map(|name| is_pinned(name, pins)).collect();
        let place = |&t: &usize| Ranked { name: names[t].into(), score: scores[t], pinned: pinned[t] };
        let targets = ranked(scores, &pinned);
        Self { schema: 1, metric: metric.into(), ranking: targets.iter().map(place).collect(), targets }
    }
}

/// Rank correlation of two lists of scores of the same targets.
#[derive(Clone, Debug, Serialize)]
pub struct Agreement {
    pub metrics: [String; 2],
    /// Kendall's tau-b, -1 to 1.
    pub kendall: f64,
    /// Spearman's rho, -1 to 1.
    pub spearman: f64,
}

fn sign(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x.signum() }
}

/// Kendall's tau-b: pairs in the same order minus pairs in opposite orders, over the geometric mean of the pairs
/// without ties in each list. 0 if all values of a list are equal.
pub fn kendall(a: &[f64], b: &[f64]) -> f64 {
    let mut agree = 0.0;
    let mut pairs = [0.0; 2];
    for i in 0..a.len() {
        for j in 0..i {
            let signs = [sign(a[i] - a[j]), sign(b[i] - b[j])];
            agree += signs[0] * signs[1];
            pairs.iter_mut().zip(signs).for_each(|(n, sign)| *n += sign.abs());
        }
    }
    let all = f64::sqrt(pairs[0] * pairs[1]);
    if all > 0.0 { agree / all } else { 0.0 }
}

/// Spearman's rho: the correlation of ranks; ties have their mean rank. 0 if all values of a list are equal.
pub fn spearman(a: &[f64], b: &[f64]) -> f64 {
    // Less the mean of all, and doubled.
    let ranks =
        |list: &[f64]| -> Vec<f64> { list.iter().map(|v| list.iter().map(|other| sign(v - other)).sum()).collect() };
    let (a, b) = (ranks(a), ranks(b));
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let all = (dot(&a, &a) * dot(&b, &b)).sqrt();
    if all > 0.0 { dot(&a, &b) / all } else { 0.0 }
}
