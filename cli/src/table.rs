//! Text tables, and number formatting.

use deltamorph::internals::Printable;
use std::sync::OnceLock;

/// Columns of the terminal; unset where there is none.
static COLUMNS: OnceLock<usize> = OnceLock::new();

/// Breaks lines that are wider than the terminal between words; what follows is indented as the line is. Control
/// characters, which names in files may have, are spelled out.
pub fn fitted(text: &str) -> String {
    let columns = COLUMNS.get().copied().unwrap_or(usize::MAX);
    text.split('\n').map(|line| wrapped(&Printable(line).to_string(), columns)).collect::<Vec<_>>().join("\n")
}

fn wrapped(line: &str, columns: usize) -> String {
    let length = |text: &str| text.chars().count();
    if length(line) <= columns {
        return line.to_owned();
    }
    let indent = &line[..line.len() - line.trim_start().len()];
    let mut lines = vec![indent.to_owned()];
    for word in line.split_whitespace() {
        match lines.last_mut() {
            Some(last) if last.as_str() == indent => last.push_str(word),
            Some(last) if length(last) + 1 + length(word) <= columns => *last += &format!(" {word}"),
            _ => lines.push(format!("{indent}{word}")),
        }
    }
    lines.join("\n")
}

/// Wraps output at the terminal's width, or at $COLUMNS.
pub fn fit_terminal() {
    let terminal = terminal_size::terminal_size_of(std::io::stdout()).map(|(columns, _)| columns.0.into());
    let stated = || std::env::var("COLUMNS").ok()?.parse().ok();
    // What states fewer does not know.
    if let Some(columns) = terminal.or_else(stated).filter(|columns| *columns >= 20) {
        let _ = COLUMNS.set(columns);
    }
}

/// A table with columns as wide as their widest cell.
pub struct Table {
    pub headings: Vec<String>,
    pub rows: Vec<Vec<String>>,
    /// Number of leading columns of words, which are aligned left.
    pub left: usize,
}

/// The text of an empty cell.
pub const NONE: &str = "–";

/// A heading, and the cell of a row.
pub type Column<'a, R> = (&'a str, &'a dyn Fn(&R) -> String);

impl Table {
    /// A table with these headings; the first `left` columns hold words.
    pub fn new(headings: &[&str], left: usize) -> Self {
        Self { headings: headings.iter().map(|h| (*h).to_owned()).collect(), rows: vec![], left }
    }

    /// A row for each of `rows`; the first `left` columns hold words. Columns that are [`NONE`] in every row are left
    /// out.
    pub fn of<R>(rows: &[R], left: usize, columns: &[Column<'_, R>]) -> Self {
        let filled = columns.iter().filter(|(_, cell)| rows.is_empty() || rows.iter().any(|row| cell(row) != NONE));
        let filled: Vec<_> = filled.collect();
        let mut table = Self::new(&filled.iter().map(|(heading, _)| *heading).collect::<Vec<_>>(), left);
        rows.iter().for_each(|row| table.row(filled.iter().map(|(_, cell)| cell(row))));
        table
    }

    pub fn row(&mut self, cells: impl IntoIterator<Item = String>) {
        self.rows.push(cells.into_iter().map(|cell| Printable(cell).to_string()).collect());
    }
}

impl std::fmt::Display for Table {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let lines: Vec<&Vec<String>> = std::iter::once(&self.headings).chain(&self.rows).collect();
        let width = |c: usize| lines.iter().filter_map(|r| r.get(c)).map(|s| s.chars().count()).max().unwrap_or(0);
        let widths: Vec<usize> = (0..self.headings.len()).map(width).collect();
        for (part, columns) in parts(&widths, self.left, COLUMNS.get().copied()).into_iter().enumerate() {
            for (i, row) in lines.iter().enumerate() {
                let cells = columns.iter().filter_map(|&c| Some((c, row.get(c)?, widths[c])));
                let cells =
                    cells.map(|(c, cell, w)| if c < self.left { format!("{cell:<w$}") } else { format!("{cell:>w$}") });
                let line = cells.collect::<Vec<_>>().join("  ");
                let above = match (part, i) {
                    (0, 0) => "",
                    (_, 0) => "\n\n",
                    _ => "\n",
                };
                write!(f, "{above}{}", line.trim_end())?;
            }
        }
        Ok(())
    }
}

/// The columns of a table, in parts that fit `room`: each begins with the columns of words, `left` of them, and has at
/// least one more.
fn parts(widths: &[usize], left: usize, room: Option<usize>) -> Vec<Vec<usize>> {
    let words: Vec<usize> = (0..left.min(widths.len())).collect();
    let width = |columns: &[usize]| columns.iter().map(|c| widths[*c] + 2).sum::<usize>() - 2;
    let mut parts = vec![words.clone()];
    for column in words.len()..widths.len() {
        let Some(part) = parts.last_mut() else { break };
        part.push(column);
        if part.len() > words.len() + 1 && room.is_some_and(|room| width(part) > room) {
            part.pop();
            parts.push(words.iter().copied().chain([column]).collect());
        }
    }
    parts
}

/// Formats `value` with three significant digits, without an exponent in common ranges.
pub fn sig3(value: f64) -> String {
    if !value.is_finite() {
        "–".into()
    } else if value == 0.0 {
        "0".into()
    } else if !(1e-3..1e6).contains(&value.abs()) {
        format!("{value:.1e}")
    } else {
        // Rounded first: 9.996 has as many decimals as 10.
        let rounded: f64 = format!("{:.2e}", value.abs()).parse().unwrap_or(value);
        let decimals = (2 - rounded.log10().floor() as i32).max(0) as usize;
        format!("{value:.decimals$}")
    }
}

pub fn optional(value: Option<f64>) -> String {
    value.map_or(NONE.into(), sig3)
}

/// Formats a count, or a mean of counts.
pub fn count(value: f64) -> String {
    if value.fract() == 0.0 { format!("{value:.0}") } else { sig3(value) }
}

pub fn percent(fraction: f64) -> String {
    format!("{} %", sig3(fraction * 100.0))
}

pub fn bytes(n: f64) -> String {
    let units = ["B", "KiB", "MiB", "GiB", "TiB"];
    let power = (0..4).find(|power| n.round() < 1024f64.powi(power + 1)).unwrap_or(4);
    let value = n.round() / 1024f64.powi(power);
    if power == 0 { format!("{value} B") } else { format!("{value:.2} {}", units[power as usize]) }
}

/// Formats a whole number with thousands separators.
pub fn thousands(n: usize) -> String {
    let digits = n.to_string();
    let comma = |place: usize| place > 0 && (digits.len() - place).is_multiple_of(3);
    let pairs = digits.char_indices().flat_map(|(place, digit)| [comma(place).then_some(','), Some(digit)]);
    pairs.flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers() {
        let usual = [0.0, 1.0, 9.994, 9.996, 52.34, 523.4, 52345.2, 0.012_34].map(sig3);
        assert_eq!(usual, ["0", "1.00", "9.99", "10.0", "52.3", "523", "52345", "0.0123"]);
        assert_eq!([1.5e-7, -0.5, f64::NAN].map(sig3), ["1.5e-7", "-0.500", "–"]);
        assert_eq!(percent(0.123), "12.3 %");
        assert_eq!([12.0, 1536.0, 3.0 * 1048576.0].map(bytes), ["12 B", "1.50 KiB", "3.00 MiB"]);
        assert_eq!([7, 43_788, 1_000_000].map(thousands), ["7", "43,788", "1,000,000"]);
    }

    #[test]
    fn wide_tables_are_cut_between_columns() {
        assert_eq!(parts(&[4, 6, 6, 6], 1, None), [[0, 1, 2, 3]]);
        assert_eq!(parts(&[4, 6, 6, 6], 1, Some(28)), [[0, 1, 2, 3]]);
        assert_eq!(parts(&[4, 6, 6, 6], 1, Some(27)), [vec![0, 1, 2], vec![0, 3]]);
        assert_eq!(parts(&[40, 6, 6], 1, Some(20)), [[0, 1], [0, 2]], "a column at least");
        assert_eq!(parts(&[9], 1, Some(5)), [[0]]);
    }
}
