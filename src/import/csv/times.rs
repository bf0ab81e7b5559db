//! Times of rows: a column of seconds, of a fraction of them, or of timecode gives the frame rate, and a column of
//! frame numbers the frames that were left out.

use super::Table;
use crate::error::{Result, reserved, shortened};
use crate::import::is_rate;
use std::mem::take;

/// Frames per second of timecode, of which one is that of a clip: the least that has all frame numbers.
const RATES: [f64; 9] = [24.0, 25.0, 30.0, 48.0, 50.0, 60.0, 90.0, 100.0, 120.0];

const HOUR: f64 = 3600.0;

/// Frames per second that are not remarked on.
const USUAL: std::ops::RangeInclusive<f32> = 1.0..=240.0;

/// A cell of a column of times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Time {
    /// In the cell's or the column's unit; of timecode whole seconds.
    count: f64,
    /// Frames beyond the seconds, in timecode alone.
    frames: Option<f64>,
    /// How many of the unit are a second, where the cell says so.
    unit: Option<f64>,
}

impl Time {
    /// Reads a number with or without a unit, a time of day, `HH:MM:SS.fraction`, or timecode,
    /// `HH:MM:SS:FF.fraction`. A date may precede these, and AM, PM or an offset follow. `before` is the cell above:
    /// clocks begin anew.
    pub fn read(cell: &str, before: Option<&Self>) -> Option<Self> {
        let number = |text: &str| text.trim().replace(',', ".").parse().ok().filter(|number: &f64| number.is_finite());
        let bare = cell.trim_end_matches(char::is_alphabetic);
        let Some(clock) = bare.split([' ', 'T', '_']).find(|part| part.contains(':')) else {
            return Some(Self { count: number(bare)?, frames: None, unit: unit(&cell[bare.len()..]) });
        };
        let clock = clock.split(['+', '-']).next()?;
        let mut parts: Vec<f64> = clock.split([':', ';']).map(number).collect::<Option<_>>()?;
        let frames = if parts.len() == 4 { parts.pop() } else { None };
        let mut count = parts.iter().fold(0.0, |count, part| 60.0 * count + part);
        let past = before.map_or(0.0, |before| before.count - count);
        if past > 6.0 * HOUR {
            count += 12.0 * HOUR * (past / (12.0 * HOUR)).ceil();
        }
        (parts.len() < 4).then_some(Self { count, frames, unit: Some(1.0) })
    }
}

/// How many of a unit are a second; `None` if it is no unit of time.
fn unit(word: &str) -> Option<f64> {
    match word.to_lowercase().as_str() {
        "s" | "sec" | "secs" | "second" | "seconds" => Some(1.0),
        "ms" | "msec" | "millis" | "milliseconds" => Some(1e3),
        "us" | "µs" | "micros" | "microseconds" => Some(1e6),
        "ns" | "nanos" | "nanoseconds" => Some(1e9),
        _ => None,
    }
}

/// Whether a column of this name, and number, holds times.
pub(super) fn is_time(name: &str, column: usize) -> bool {
    let name = name.to_lowercase();
    name.contains("time") || unit(&name) == Some(1.0) && name != "s" || name == "ts" || name == "t" && column == 0
}

/// Whether a column of this name holds frame numbers.
fn is_frame(name: &str) -> bool {
    name.to_lowercase().starts_with("frame")
}

/// The seconds of times in a column called `name`; `None` if their unit is not known.
fn seconds(name: &str, times: &[Time]) -> Option<Vec<f64>> {
    let (first, last) = (times.first()?, times.last()?);
    if first.frames.is_some() {
        let frames: Vec<f64> = times.iter().filter_map(|time| time.frames).collect();
        let most = frames.iter().fold(0.0f64, |most, frames| most.max(frames.floor()));
        let mut rates = RATES.iter().filter(|rate| **rate > most);
        // Some writers put the milliseconds of the second behind the point, not the part of the frame.
        let of_second = rates.clone().filter(|_| most > 0.0).find(|rate| {
            let late = |frames: &f64| frames.fract() - frames.floor() / **rate;
            frames.iter().map(late).all(|late| late > -0.001 && late < 1.0 / **rate + 0.001)
        });
        // Otherwise how many frames a second has is seen where one ends.
        let rate = of_second.or_else(|| rates.next().filter(|_| first.count != last.count))?;
        let at = |part: fn(f64, f64) -> f64| {
            let parts = times.iter().zip(&frames);
            parts.map(|(time, frames)| time.count + part(*frames, *rate)).collect::<Vec<_>>()
        };
        if of_second.is_some() {
            return Some(at(|frames, _| frames.fract()));
        }
        let whole = at(|frames, rate| frames.floor() / rate);
        // Frames in step: the rest says when within its frame a row was written.
        let is_even = whole.windows(3).all(|at| (at[2] - at[1] - at[1] + at[0]).abs() < 0.5 / rate);
        return Some(if is_even { whole } else { at(|frames, rate| frames / rate) });
    }
    let step = (last.count - first.count) / (times.len() as f64 - 1.0);
    let word = name.split(|c: char| !c.is_alphanumeric()).rfind(|word| !word.is_empty());
    let stated = first.unit.or_else(|| unit(word?)).filter(|unit| (1e-3..=1e3).contains(&(step / unit)));
    let unit = match step {
        _ if stated.is_some() => stated?,
        0.0..1.0 => 1.0,
        // Seconds, or frames.
        1.0..2.0 => return None,
        2.0..1e3 => 1e3,
        1e3..1e6 => 1e6,
        _ => 1e9,
    };
    Some(times.iter().map(|time| time.count / unit).collect())
}

/// Makes frames of the rows, by the first column of times or frame numbers that says when they are. Returns the frame
/// rate, if it is of times. A rate that `is_given` goes before times.
pub(super) fn space(table: &mut Table, is_given: bool) -> Result<Option<f32>> {
    let clocks = take(&mut table.clocks);
    for (column, times) in clocks.iter().filter(|_| !is_given) {
        let name = shortened(&table.names[*column]);
        let seconds = seconds(&name, times).unwrap_or_default();
        if let Some(fps) = at(table, &name, &seconds, false)? {
            if !USUAL.contains(&fps) {
                let text = format!("column '{name}' gives {fps} frames a second; if that is not meant, give --fps");
                table.notes.push(text);
            }
            return Ok(Some(fps));
        }
    }
    // Rows that have times are not counted.
    if is_given && clocks.iter().any(|(column, times)| seconds(&table.names[*column], times).is_some()) {
        return Ok(None);
    }
    for column in 0..table.names.len() {
        let name = shortened(&table.names[column]);
        let numbers: Vec<f64> = match clocks.iter().find(|(clock, _)| *clock == column) {
            Some((_, times)) if !is_given => {
                times.iter().map(|time| time.frames.map_or(time.count, f64::floor)).collect()
            }
            _ if is_frame(&name) => {
                table.values.iter().skip(column).step_by(table.names.len()).copied().map(f64::from).collect()
            }
            _ => continue,
        };
        // Larger ones are not exact in float32.
        let is_count = numbers.iter().all(|number| number.fract() == 0.0 && number.abs() < 16_777_216.0);
        if is_count && at(table, &name, &numbers, true)?.is_some() {
            break;
        }
    }
    Ok(None)
}

/// Where rows are not evenly spaced at `times`, within half a frame, or frames were left out, they become frames that
/// are, by interpolation. Returns frames per unit; `None` if times descend, or do not ascend. `are_counts`: they are
/// numbers of frames.
fn at(table: &mut Table, name: &str, times: &[f64], are_counts: bool) -> Result<Option<f32>> {
    let [first, .., last] = *times else { return Ok(None) };
    let rate = |steps: usize| Some((steps as f64 / (last - first)) as f32).filter(|fps| is_rate(*fps));
    let Some(fps) = rate(times.len() - 1).filter(|_| times.is_sorted()) else { return Ok(None) };
    let is_late = |(i, time): (usize, &f64)| ((time - first) * f64::from(fps) - i as f64).abs() > 0.5;
    let mut steps: Vec<f64> = times.windows(2).map(|two| two[1] - two[0]).filter(|step| *step > 0.0).collect();
    steps.sort_unstable_by(f64::total_cmp);
    let usual = if are_counts { steps[0] } else { steps[steps.len() / 2] };
    // At most four frames for a row, however long the pauses are.
    let count = (((last - first) / usual).round() as usize).clamp(1, 4 * (times.len() - 1));
    let is_gap = count + 1 != times.len() && steps[steps.len() - 1] > 1.5 * usual;
    if !is_gap && !times.iter().enumerate().any(is_late) {
        return Ok(Some(fps));
    }
    let mut row = 0;
    let (columns, values) = (table.names.len(), &table.values);
    let mut frames = reserved((count + 1) * columns, || "the frames of a clip".into())?;
    for frame in 0..=count {
        let time = first + (last - first) * (frame as f64 / count as f64);
        while row + 2 < times.len() && times[row + 1] <= time {
            row += 1;
        }
        let span = times[row + 1] - times[row];
        let part = if span > 0.0 { ((time - times[row]) / span).clamp(0.0, 1.0) as f32 } else { 1.0 };
        let [from, to] = [row, row + 1].map(|row| &values[row * columns..][..columns]);
        frames.extend(from.iter().zip(to).map(|(from, to)| from * (1.0 - part) + to * part));
    }
    table.values = frames;
    let what = "rows are not evenly spaced in column";
    let (frames, rows) = (count + 1, times.len());
    table.notes.push(format!("{what} '{name}': {frames} frames are interpolated from {rows} rows"));
    Ok(rate(count))
}
