//! The plot of `lod`: errors against the share of targets kept, in ranked and in random orders.

use super::Point;
use super::gauge::Gauge;
use super::order::Order;
use crate::args::lod::Metric;
use crate::plots::{Axes, Chart, Figure, Look, Point as Mark, Series};

/// Plots errors of vertices, at every twentieth of the targets; for a single order by a metric of pictures, differences
/// of pictures, at every quarter.
pub fn figure(
    gauge: &Gauge<'_>,
    metrics: &[Metric],
    orders: &[Order],
    curves: &[Vec<Point>],
    measured: &str,
) -> Figure {
    let of_pictures = matches!(metrics, [metric] if metric.is_of_pictures());
    let mut series: Vec<Series> = if of_pictures { vec![] } else { of_vertices(gauge, orders) };
    if let ([order], [curve], true) = (orders, curves, of_pictures) {
        let share = |p: &Point| 100.0 * p.kept as f64 / order.ranking.len().max(1) as f64;
        let of = |value: fn(&Point) -> f64| curve.iter().map(|p| Mark::new(share(p), value(p), 0.0)).collect();
        series.push(line(&order.metric, 0, of(|p| p.error_rel)));
        series.push(random(gauge, of(|p| p.error_random_rel)));
    }
    let what = if of_pictures { "difference of pictures" } else { "error of vertices, % of the diagonal" };
    let error = match of_pictures {
        true => "Differences are means over frames that are spread evenly.",
        false => "Errors are roots of the mean square over vertices and frames.",
    };
    Figure {
        slug: "lod".into(),
        caption: String::new(),
        title: "What is lost where fewer targets are kept".into(),
        subtitle: [
            format!("{}, {} targets, {measured}", gauge.input.name, gauge.input.kept.targets.len()),
            error.into(),
        ],
        chart: Chart::Lines {
            labels: ["share of the targets that are kept, %", what],
            axes: Axes::CountsFromZero,
            series,
        },
    }
}

fn of_vertices(gauge: &Gauge<'_>, orders: &[Order]) -> Vec<Series> {
    let names: Vec<&str> = gauge.input.kept.targets.iter().map(|t| t.name.as_str()).collect();
    let scale = 100.0 / crate::verify::scale(gauge.input.kept.diagonal);
    let marks = |error: &dyn Fn(usize) -> f64| {
        let mark = |part: usize| Mark::new(5.0 * part as f64, error((names.len() * part).div_ceil(20)) * scale, 0.0);
        (0..=20).map(mark).collect()
    };
    let by_order = |(i, order): (usize, &Order)| {
        line(&order.metric, i, marks(&|kept| gauge.vertices.of(&order.keeps(&names, kept))))
    };
    let mut series: Vec<Series> = orders.iter().enumerate().map(by_order).collect();
    let mean = |kept: usize| {
        let of = |order: &Vec<usize>| gauge.vertices.of(&super::gauge::first(order, kept));
        gauge.random.iter().map(of).sum::<f64>() / gauge.random.len().max(1) as f64
    };
    series.push(random(gauge, marks(&mean)));
    series
}

fn line(metric: &str, hue: usize, points: Vec<Mark>) -> Series {
    // The dark variants: random orders have the light ones.
    let dark = [0, 2, 5, 7][hue % 4];
    Series { label: format!("by {metric}"), look: Look::new(hue + usize::from(hue >= 5), dark), points }
}

fn random(gauge: &Gauge<'_>, points: Vec<Mark>) -> Series {
    Series { label: format!("random, mean of {}", gauge.random.len()), look: Look::PLAIN, points }
}
