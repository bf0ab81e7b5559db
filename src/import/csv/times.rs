//! Times of rows: a column of seconds, of a fraction of them, or of timecode gives the frame rate.

use crate::import::is_rate;

/// Frames per second of timecode, of which one is that of a clip: the least that has all frame numbers.
const RATES: [f64; 9] = [24.0, 25.0, 30.0, 48.0, 50.0, 60.0, 90.0, 100.0, 120.0];

/// A cell of a column of times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Time {
    /// In the column's unit; of timecode whole seconds.
    count: f64,
    /// Frames beyond the seconds, in timecode alone.
    frames: Option<f64>,
}

impl Time {
    /// Reads a number, `HH:MM:SS.fraction` or timecode, `HH:MM:SS:FF.fraction`; a date may precede it.
    pub fn read(cell: &str) -> Option<Self> {
        let number = |text: &str| text.replace(',', ".").parse().ok().filter(|number: &f64| number.is_finite());
        let clock = cell.rsplit([' ', 'T']).next()?.trim_end_matches('Z');
        let mut parts: Vec<f64> = clock.split([':', ';']).map(number).collect::<Option<_>>()?;
        let frames = if parts.len() == 4 { parts.pop() } else { None };
        let count = parts.iter().fold(0.0, |count, part| 60.0 * count + part);
        (parts.len() < 4).then_some(Self { count, frames })
    }
}

/// Whether a column of this name holds times.
pub(super) fn is_time(name: &str) -> bool {
    let name = name.to_lowercase();
    name.contains("time") || ["sec", "secs", "second", "seconds"].contains(&name.as_str())
}

/// Whether the name says that times are in seconds, as in `time(s)`.
fn is_seconds(name: &str) -> bool {
    let name = name.to_lowercase();
    let unit = name.split(|c: char| !c.is_alphanumeric()).rfind(|word| !word.is_empty());
    unit.is_some_and(|unit| ["s", "sec", "secs", "second", "seconds"].contains(&unit))
}

/// The seconds of times in a column called `name`; `None` if their unit is not known.
fn seconds(name: &str, times: &[Time]) -> Option<Vec<f64>> {
    let (first, last) = (times.first()?, times.last()?);
    if let Some(most) = times.iter().filter_map(|time| time.frames).reduce(f64::max) {
        // How many frames a second has is seen where one ends.
        let rate = *RATES.iter().find(|rate| **rate > most.floor() && first.count != last.count)?;
        return Some(times.iter().map(|time| time.count + time.frames.unwrap_or(0.0) / rate).collect());
    }
    let step = (last.count - first.count) / (times.len() as f64 - 1.0);
    let unit = match step {
        _ if is_seconds(name) => 1.0,
        0.0..1.0 => 1.0,
        // Seconds, or frames.
        1.0..2.0 => return None,
        2.0..1e3 => 1e3,
        1e3..1e6 => 1e6,
        _ => 1e9,
    };
    Some(times.iter().map(|time| time.count / unit).collect())
}

/// The frame rate of rows at `times`, of a column called `name`. Where rows are not evenly spaced, within half a frame,
/// `values` become frames that are, by interpolation. `None` if the times give no rate: then nothing changes.
pub(super) fn frame_rate(name: &str, times: &[Time], columns: usize, values: &mut Vec<f32>) -> Option<f32> {
    let times = seconds(name, times)?;
    let (first, last) = (*times.first()?, *times.last()?);
    let mut steps: Vec<f64> = times.windows(2).map(|two| two[1] - two[0]).collect();
    let rate = |steps: usize| Some((steps as f64 / (last - first)) as f32).filter(|fps| is_rate(*fps));
    let fps = rate(steps.len())?;
    if !times.is_sorted() {
        return None;
    }
    let is_late = |(i, time): (usize, &f64)| ((time - first) * f64::from(fps) - i as f64).abs() > 0.5;
    if !times.iter().enumerate().any(is_late) {
        return Some(fps);
    }
    steps.sort_unstable_by(f64::total_cmp);
    // The usual step, but at most four frames for a row.
    let usual = ((last - first) / steps[steps.len() / 2]).round() as usize;
    let count = usual.clamp(1, 4 * steps.len());
    let mut row = 0;
    let mut frames = Vec::with_capacity((count + 1) * columns);
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
    *values = frames;
    rate(count)
}
