//! Layout of a figure for a given width: nothing is cut off at any width.

use super::axis::Axis;
use super::{Chart, Figure};
use textwrap::WordSplitter;

/// Sizes of text.
pub const TITLE: f64 = 18.0;
pub const TEXT: f64 = 12.5;
/// Line spacing, as a multiple of the text size.
pub const LEADING: f64 = 1.35;
/// Height of the data of a line chart.
pub const DATA: f64 = 280.0;
/// Height of a bar, and the gap to the next.
pub const BAR: f64 = 20.0;
pub const GAP: f64 = 14.0;
/// Space for the numbers below an axis.
pub const TICKS: f64 = 24.0;
/// Space for a line of the legend.
pub const ENTRY: f64 = 22.0;
/// Line and marker of an entry of the legend, before its label.
pub const SAMPLE: f64 = 32.0;
pub const MARGIN: f64 = 14.0;
/// Least share of the width for bars; if text beside them would leave less, it is placed above.
const BARS: f64 = 0.3;

/// The parts of a figure, in points.
#[derive(Clone, Debug)]
pub struct Plan {
    pub width: f64,
    pub height: f64,
    pub title: Vec<String>,
    pub subtitle: Vec<String>,
    /// Top of the data.
    pub top: f64,
    /// The name of the x axis, in lines.
    pub counted: Vec<String>,
    /// Columns of the legend.
    pub columns: usize,
    /// Height of a bar with its text and the gap below.
    pub row: f64,
    /// Space for text before and after bars; `None` if it is above them.
    pub beside: Option<(f64, f64)>,
}

impl Plan {
    pub fn new(figure: &Figure, width: f64) -> Self {
        let room = width - 2.0 * MARGIN;
        let title = wrapped(&figure.title, TITLE, room);
        let subtitle: Vec<String> = figure.subtitle.iter().flat_map(|line| wrapped(line, TEXT, room)).collect();
        let top = MARGIN + LEADING * (TITLE * title.len() as f64 + TEXT * subtitle.len() as f64) + 12.0;
        let mut plan = Self {
            width,
            height: 0.0,
            title,
            subtitle,
            top,
            counted: vec![],
            columns: 1,
            row: BAR + GAP,
            beside: None,
        };
        let below = match &figure.chart {
            Chart::Lines { labels, axes, series } => {
                let entry = SAMPLE + widest(series.iter().map(|series| &series.label)) + 12.0;
                let [x, _] = Axis::of_lines(*axes, series);
                plan.counted = wrapped(&x.named(labels[0]), TEXT, room);
                plan.columns = ((room / entry) as usize).clamp(1, series.len().max(1));
                let legend = ENTRY * series.len().div_ceil(plan.columns) as f64;
                DATA + LEADING * TEXT * plan.counted.len() as f64 + GAP + legend
            }
            Chart::Bars { bars, .. } => {
                let left = MARGIN + widest(bars.iter().map(|bar| &bar.label)) + 10.0;
                let right = MARGIN + widest(bars.iter().map(|bar| &bar.remark)) + 10.0;
                plan.beside = (width - left - right >= BARS * width).then_some((left, right));
                if plan.beside.is_none() {
                    plan.row += 2.0 * LEADING * TEXT;
                }
                plan.row * bars.len() as f64
            }
        };
        plan.height = top + below + TICKS + 10.0;
        plan
    }

    /// Width and height with `scale` pixels per point.
    pub fn size(&self, scale: f64) -> (u32, u32) {
        ((self.width * scale) as u32, (self.height * scale) as u32)
    }
}

/// Approximate width of a text, rounded up generously: browsers set SVG in their own fonts.
pub fn width(text: &str, size: f64) -> f64 {
    0.58 * size * text.chars().count() as f64
}

fn widest<'a>(texts: impl Iterator<Item = &'a String>) -> f64 {
    texts.map(|text| width(text, TEXT)).fold(0.0, f64::max)
}

/// Breaks `text` into lines of at most `room`; longer words are split.
fn wrapped(text: &str, size: f64, room: f64) -> Vec<String> {
    let most = ((room / width("x", size)) as usize).max(1);
    let lines = textwrap::wrap(text, textwrap::Options::new(most).word_splitter(WordSplitter::NoHyphenation));
    lines.into_iter().map(String::from).filter(|line| !line.is_empty()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_break_where_there_is_no_room() {
        let room = width("xxxxxxxxxx", TEXT) + 0.1;
        assert_eq!(wrapped("one two three", TEXT, room), ["one two", "three"]);
        assert_eq!(wrapped("one extraordinarily", TEXT, room), ["one", "extraordin", "arily"]);
        assert!(wrapped("", TEXT, room).is_empty());
        assert_eq!(wrapped("ab", TEXT, 0.0), ["a", "b"]);
    }
}
