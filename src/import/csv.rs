//! Weight clips from CSV: a header of target names, then one row of weights per frame.
//!
//! The frame rate is given by the caller, or stated by a column of times, or part of the file's name
//! (`walk_30fps.csv`).

mod times;

pub use super::DEFAULT_FPS;
use crate::error::{Error, Result, ensure, refuse};
use crate::import::{shortened, stem};
use crate::io::{TEXT_MAX, read_bounded, write_replacing};
use crate::weights::WeightClip;
use csv::{ReaderBuilder, StringRecord, Trim};
use std::collections::HashSet;
use std::io::Write;
use std::path::Path;
use times::{Time, is_time};

/// Reads a weights CSV: a header of target names, then one row per frame.
///
/// Columns are separated by commas, semicolons or tabs, whichever the header has most of, or as a line `sep=;` before
/// it says. Numbers have a decimal point or a decimal comma. Lines that begin with `#` or, before the header, `//` are
/// comments; these, spaces around names and numbers, empty lines and a byte order mark are ignored. An empty cell has
/// the weight before it in its column, or 0.
///
/// Weights may be any finite numbers, also below 0 and above 1. A column without a name is called after its number,
/// `column 3`. A column without any number, such as timecode, holds NaN, which [`WeightClip::bind`] refuses: like other
/// columns that name no target, [`WeightClip::renamed`] leaves it out. A header without rows is a clip of 0 frames.
///
/// The frame rate is `fps`; `None` takes the one that a column of times states, called `time`, `timestamp`, `Timecode`
/// or the like: rows that are not evenly spaced become frames that are, by interpolation. Without such a column it is
/// the one in the file's name, the number before the last "fps" in it (`walk_30fps.csv`), or else [`DEFAULT_FPS`].
///
/// Takes 200 bytes of memory at most for each byte of the file, and 1 MiB, whatever it counts.
///
/// # Errors
/// [`Error::Io`] if the file cannot be read, [`Error::Input`] with line and column if it is not such a CSV,
/// [`Error::Invalid`] if `fps` is not a positive number, [`Error::OutOfMemory`].
pub fn read(path: &Path, fps: Option<f32>) -> Result<WeightClip> {
    let bytes = read_bounded(path, TEXT_MAX, "split the clip")?;
    let given = fps.map(super::frame_rate).transpose()?;
    let Table { names, mut values, times } = Table::parse(path, &bytes)?;
    let timed = times.filter(|_| given.is_none());
    let timed = timed.and_then(|(at, times)| times::frame_rate(&names[at], &times, names.len(), &mut values));
    let fps = given.or(timed).or_else(|| fps_of_name(path)).unwrap_or(DEFAULT_FPS);
    Ok(WeightClip { name: stem(path), names, fps, values })
}

/// What a CSV holds.
struct Table {
    names: Vec<String>,
    /// Row after row.
    values: Vec<f32>,
    /// The first column of times, and those.
    times: Option<(usize, Vec<Time>)>,
}

impl Table {
    fn parse(path: &Path, bytes: &[u8]) -> Result<Self> {
        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        let line = |at: usize| 1 + bytes[..at.min(bytes.len())].iter().filter(|&&b| b == b'\n').count();
        let refuse = |at: usize, column: &str, what: &str, remedy: &str| {
            let column = if column.is_empty() { String::new() } else { format!("column '{column}', ") };
            Error::input(path, format!(": {column}line {}", line(at)), what, remedy)
        };
        let text = std::str::from_utf8(bytes);
        let undecoded = "bytes that are not UTF-8 text";
        let text = text.map_err(|e| refuse(e.valid_up_to(), "", undecoded, "save the file as CSV in UTF-8"))?;
        let (header, separator) = header(text);
        let is_json = text[header..].trim_start().starts_with(['{', '[']);
        let remedy = "write a header of target names and one row of weights per frame, separated by commas";
        ensure!(!is_json, refuse(header, "", "JSON, where a CSV file is expected", remedy));
        // Flexible, since a ragged row is refused below, with its line.
        let mut reader = ReaderBuilder::new();
        reader.has_headers(false).flexible(true).trim(Trim::All).comment(Some(b'#')).delimiter(separator);
        let mut reader = reader.from_reader(&text.as_bytes()[header..]);
        let mut record = StringRecord::new();
        let mut table = Self { names: vec![], values: vec![], times: None };
        let mut kinds: Vec<Kind> = vec![];
        let mut least = 0;
        // Reading from text in memory, with rows of any length, cannot fail.
        while reader.read_record(&mut record).map_err(|_| refuse(header, "", undecoded, "save it again"))? {
            // The reader's position is that of line breaks before the record.
            let at = header + record.position().map_or(0, |position| position.byte() as usize);
            let at = at + bytes[at..].iter().take_while(|b| matches!(b, b'\r' | b'\n')).count();
            if table.names.is_empty() {
                table.names = names(&record).map_err(|(name, what, remedy)| refuse(at, name, &what, remedy))?;
                table.times = table.names.iter().position(|name| is_time(name)).map(|column| (column, vec![]));
                // A last comma may be in the header alone.
                least = record.len() - usize::from(record.len() > 1 && record[record.len() - 1].is_empty());
                kinds.resize(record.len(), Kind::default());
                continue;
            }
            let columns = table.names.len();
            let fits = record.len() >= least && record.iter().skip(columns).all(str::is_empty);
            let what = || format!("values in the row: {}, but columns in the header: {columns}", record.len());
            ensure!(fits, refuse(at, "", &what(), "give one value per column in every row"));
            let what = || format!("{}: line {}: there is no memory for more rows", path.display(), line(at));
            let has_room = table.values.try_reserve(columns).is_ok();
            ensure!(has_room, Error::out_of_memory(what(), "split the clip"));
            for (i, kind) in kinds.iter_mut().enumerate() {
                let cell = record.get(i).unwrap_or_default();
                let weight = match number(cell) {
                    Some(weight) => {
                        let what = || format!("the weight '{cell}' is not a finite number");
                        let remedy = "replace it with a finite number";
                        ensure!(weight.is_finite(), refuse(at, &table.names[i], &what(), remedy));
                        kind.has_numbers = true;
                        weight
                    }
                    None if cell.is_empty() => {
                        table.values.len().checked_sub(columns).map_or(0.0, |before| table.values[before])
                    }
                    None => {
                        kind.text.get_or_insert_with(|| (at, shortened(cell)));
                        f32::NAN
                    }
                };
                table.values.push(weight);
            }
            // Times that cannot be read are no times.
            table.times = table.times.and_then(|(column, mut times)| {
                times.push(Time::read(record.get(column)?)?);
                Some((column, times))
            });
        }
        let remedy = "give a header of target names and one row per frame";
        ensure!(!table.names.is_empty(), Error::input(path, "", "an empty file", remedy));
        // A column of text alone is none of weights, unless no other is.
        let time = table.times.as_ref().map(|(column, _)| *column);
        let all_text = !kinds.iter().any(|kind| kind.has_numbers);
        let cells = kinds.iter().enumerate().filter(|(i, kind)| kind.has_numbers || all_text && time != Some(*i));
        let first = cells.filter_map(|(i, kind)| Some((kind.text.as_ref()?, i))).min();
        if let Some(((at, cell), i)) = first {
            let what = format!("'{cell}' is not a number");
            return Err(refuse(*at, &table.names[i], &what, "write weights as decimal numbers"));
        }
        Ok(table)
    }
}

/// What the cells of a column hold.
#[derive(Clone, Debug, Default)]
struct Kind {
    has_numbers: bool,
    /// Where the first cell of other text is, and its beginning.
    text: Option<(usize, String)>,
}

/// Where the header begins, and the separator of columns.
fn header(text: &str) -> (usize, u8) {
    let mut stated = None;
    let mut at = 0;
    let mut first = "";
    for line in text.split_inclusive(['\n', '\r']) {
        let words = line.trim();
        let separator = line.trim_start_matches([' ', '"']);
        if separator.get(..4).is_some_and(|word| word.eq_ignore_ascii_case("sep=")) {
            stated =
                separator.as_bytes().get(4).copied().filter(|b| b.is_ascii() && !b"\r\n\"#".contains(b)).or(stated);
        } else if !(words.is_empty() || words.starts_with('#') || words.starts_with("//")) {
            first = line;
            break;
        }
        at += line.len();
    }
    // Outside quotes.
    let bare: String = first.split('"').step_by(2).collect();
    let most = [b'\t', b';', b','].into_iter().max_by_key(|by| bare.bytes().filter(|b| b == by).count());
    (at, stated.or(most).unwrap_or(b','))
}

/// The names of columns, or the name of one that is wrong, what is, and the remedy.
fn names(header: &StringRecord) -> Result<Vec<String>, (&str, String, &'static str)> {
    let mut seen = HashSet::new();
    let second = header.iter().find(|name| !name.is_empty() && !seen.insert(*name));
    let stated = || header.iter().filter(|name| !name.is_empty());
    // Numbers may be names, but not those of weights.
    let is_counted = |name: &str| name.bytes().all(|b| b.is_ascii_digit());
    if !seen.is_empty()
        && stated().all(|name| number(name).is_some())
        && (second.is_some() || !stated().all(is_counted))
    {
        let remedy = "put a row before it that names each column after its target";
        return Err(("", "numbers where the header is expected: names are missing".into(), remedy));
    }
    if let Some(name) = second {
        return Err((name, "the second column of this name".into(), "rename or remove one of them"));
    }
    let name = |(i, name): (usize, &str)| if name.is_empty() { format!("column {}", i + 1) } else { name.to_owned() };
    Ok(header.iter().enumerate().map(name).collect())
}

/// A number with a decimal point or comma, or a percentage.
fn number(cell: &str) -> Option<f32> {
    let bare = cell.strip_suffix('%').map_or(cell, str::trim_end);
    let comma = || if bare.contains('.') { None } else { bare.replacen(',', ".", 1).parse().ok() };
    let number: f32 = bare.parse().ok().or_else(comma)?;
    Some(if bare.len() < cell.len() { number / 100.0 } else { number })
}

/// Returns the frames per second that a file's name states: the number before the last "fps" in it, as in
/// `walk_30fps.csv` or `Walk_29.97FPS_take2.csv`.
fn fps_of_name(path: &Path) -> Option<f32> {
    let stem = path.file_stem()?.to_str()?.to_ascii_lowercase();
    let (before, _) = stem.rsplit_once("fps")?;
    let words = before.trim_end_matches(|c: char| c.is_ascii_digit() || c == '.');
    let number = &before[words.len()..];
    number.parse().ok().filter(|fps| super::is_rate(*fps))
}

/// Writes a weights CSV that [`read`] reads back unchanged, except for the frame rate, which only a name like
/// `walk_30fps.csv` can carry.
///
/// # Errors
/// [`Error::Invalid`] if the clip has no columns, two of one name, a name that does not read back (empty, with spaces
/// around it, or like a comment), or a weight that is not finite; [`Error::Io`] if the file cannot be written.
pub fn write(path: &Path, clip: &WeightClip) -> Result<()> {
    clip.check()?;
    let what = || format!("clip '{}' has no columns", clip.name);
    ensure!(!clip.names.is_empty(), what(), "give it a column per target");
    let mut out = csv::Writer::from_writer(vec![]);
    // Writing to memory cannot fail; if it did, the rows would be missed below.
    let _ = out.write_record(&clip.names);
    for row in clip.values.chunks_exact(clip.names.len()) {
        let _ = out.write_record(row.iter().map(f32::to_string));
    }
    let bytes = out.into_inner().unwrap_or_default();
    let back = Table::parse(path, &bytes);
    if !back.is_ok_and(|table| table.names == clip.names && table.values == clip.values) {
        let odd = |name: &&String| name.trim() != name.as_str() || name.is_empty();
        let name = clip.names.iter().find(odd).unwrap_or(&clip.names[0]);
        let what = format!("clip '{}': the column name '{name}' does not read back from CSV", clip.name);
        return refuse(what, "rename the column: not empty, without spaces around it, not like a comment");
    }
    write_replacing(path, |out| out.write_all(&bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_name_file_line_and_column() {
        for (text, expected) in [
            (&b""[..], "w.csv: an empty file"),
            (b"a,b\n1,2\n3\n", "w.csv: line 3: values in the row: 1, but columns in the header: 2"),
            (b"a,b\n1,2\n3,x1\n", "column 'b', line 3: 'x1' is not a number"),
            (b"a,b\n1,NaN\n", "column 'b', line 2: the weight 'NaN' is not a finite"),
            (b"a,b\n1e99,0\n", "column 'a', line 2"),
            (b"a,b,a\n", "column 'a', line 1: the second column"),
            (b"# 60\nx,x\nno,no\n", "column 'x', line 2: the second column"),
            (b"\n0.5,0.25\n0,1\n", "w.csv: line 2: numbers where the header is expected"),
            (b"0,1,0\n", "line 1: numbers where the header is expected"),
            (b"\xef\xbb\xbf {\"exportFps\": 60}", "w.csv: line 1: JSON, where a CSV file"),
            (b"a,b\nx,y\n", "column 'a', line 2: 'x' is not a number"),
            (b"time,a\n00:01,\n00:02,no\n", "column 'a', line 3: 'no' is not a number"),
            (b"a;b\n1;2\n1,5;1.5,0\n", "column 'b', line 3: '1.5,0' is not a number"),
            (b"a,b,\n1,2,3,4\n", "line 2: values in the row: 4, but columns in the header: 3"),
            (b"a,b\r\n1,2\r\n\r\n3\r\n", "line 4"),
            (b"a,b\n1,\xe9\n", "w.csv: line 2: bytes that are not UTF-8"),
        ] {
            crate::testing::says(Table::parse(Path::new("w.csv"), text).map(|_| ()), &[expected]);
        }
    }

    #[test]
    fn the_frame_rate_is_given_or_read_from_the_name() {
        let of = |name: &str| fps_of_name(Path::new(name));
        assert_eq!(of("weights/walk_30fps.csv"), Some(30.0));
        assert_eq!(of("a.b_29.97FPS.csv"), Some(29.97));
        assert_eq!(of("walk24fps_take_2.csv"), Some(24.0));
        for none in ["walk.csv", "fps.csv", "_fps.csv", "a_0fps.csv", "a_inffps.csv", "a_1.2.3fps.csv", "30/fps.csv"] {
            assert_eq!(of(none), None, "{none}");
        }
        let dir = tempfile::tempdir().unwrap();
        for (name, given, expected) in
            [("x_24fps.csv", Some(60.0), 60.0), ("x_24fps.csv", None, 24.0), ("x.csv", None, DEFAULT_FPS)]
        {
            let path = dir.path().join(name);
            std::fs::write(&path, "a\n").unwrap();
            assert_eq!(read(&path, given).unwrap().fps, expected);
            crate::testing::says(read(&path, Some(f32::NAN)), &["the frame rate is NaN"]);
        }
    }

    #[test]
    fn clips_are_read_however_they_are_written() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("talk_24fps.csv");
        let values = vec![0.1, -0.0, 1.0 / 3.0, 1e-20, 2.5, 0.0];
        let clip = WeightClip { name: "talk_24fps".into(), names: vec!["a".into(), "b,\"c".into()], fps: 24.0, values };
        write(&path, &clip).unwrap();
        assert_eq!(read(&path, None).unwrap(), clip);

        std::fs::write(&path, b"\xef\xbb\xbfjawOpen,b\n").unwrap();
        let empty = read(&path, None).unwrap();
        assert_eq!((&empty.names[..], empty.frame_count()), (&["jawOpen".to_owned(), "b".to_owned()][..], 0));
        assert!(read(&dir.path().join("none.csv"), None).unwrap_err().to_string().contains("none.csv: cannot read"));
        assert!(write(&path, &WeightClip::default()).is_err());
    }

    fn table(text: &str) -> Table {
        Table::parse(Path::new("w.csv"), text.as_bytes()).unwrap_or_else(|e| panic!("{text:?}: {e}"))
    }

    #[test]
    fn what_is_no_weight_is_left_to_those_who_know_the_targets() {
        let clip = "jawOpen,smile\n0.5,0.25\n-1,0.125\n";
        let plain = table(clip);
        for (text, others) in [
            ("\u{feff}sep=;\r\njawOpen;smile\r\n0,5;0,25\r\n-1;0,125", &[][..]),
            ("\"SEP=\t\"\n jawOpen\tsmile\n0.5\t0.25\n-100 %\t\"0,125\"\n", &[]),
            ("# made by\n\n// hand\njawOpen,smile\n# first\n0.5,0.25\n-1,0.125\n", &[]),
            ("jawOpen,smile,\n0.5,0.25,\n-1,0.125\n", &["column 3"]),
            (",jawOpen,smile\n0,0.5,0.25\n1,-1,0.125\n", &["column 1"]),
            ("Unnamed: 0,frame number,jawOpen,smile\n0,1,0.5,0.25\n1,2,-1,0.125\n", &["Unnamed: 0", "frame number"]),
            ("Timecode,jawOpen,Head Yaw,smile\n1:2:3:4,0.5,7,0.25\n1:2:3:5.5,-1,8,0.125\n", &["Timecode", "Head Yaw"]),
            ("Subject,jawOpen,smile,state\nme,0.5,0.25,\nme,-1,0.125,lost\n", &["Subject", "state"]),
        ] {
            let found = table(text);
            let clip = WeightClip { names: found.names, values: found.values, ..WeightClip::default() };
            let (renamed, lost) = clip.renamed(&["jawOpen", "smile"]);
            assert_eq!((&renamed.names, &renamed.values), (&plain.names, &plain.values), "{text:?}");
            assert_eq!(lost, others, "{text:?}");
        }
        assert_eq!(table("a,b\n,1\n2,\n,3\n").values, [0.0, 1.0, 2.0, 1.0, 2.0, 3.0]);
    }

    #[test]
    fn a_column_of_times_gives_the_frames() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("x_24fps.csv");
        let coded = |frames: std::ops::Range<u32>, rate: u32| {
            frames
                .map(|frame| format!("10:59:{:02}:{:02}.25,{frame}\n", frame / rate, frame % rate))
                .collect::<String>()
        };
        for (header, rows, fps) in [
            ("viseme_S,time_s\n", "0,0\n0.5,0.25\n1,0.5\n".to_owned(), 4.0),
            ("time(s),a\n", "0,0\n2,1\n4,2\n".to_owned(), 0.5),
            ("timestamp_ms,a\n", "5,0\n38,1\n72,2\n105,3\n".to_owned(), 30.0),
            ("Time;a\n", "1,25;0\n1,5;1\n1,75;2\n".to_owned(), 4.0),
            ("timestamp,a\n", "1732700000000000,0\n1732700000020000,1\n1732700000040000,2\n".to_owned(), 50.0),
            ("timestamp,a\n", "2024-11-27T10:59:59.5Z,0\n2024-11-27T10:59:59.75Z,1\n".to_owned(), 4.0),
            ("Timecode,a\n", coded(50..70, 60), 60.0),
            ("Timecode,a\n", coded(20..40, 25), 25.0),
            // No rate: frames of one second, frames or seconds, no second row, times that fall or are none.
            ("Timecode,a\n", coded(3..20, 60), 24.0),
            ("time,a\n", "0,0\n1,1\n2,2\n".to_owned(), 24.0),
            ("time,a\n", "0,0\n".to_owned(), 24.0),
            ("time,a\n", "0,0\n0.5,1\n0.25,2\n".to_owned(), 24.0),
            ("time,a\n", "0,0\nnever,1\n".to_owned(), 24.0),
        ] {
            let rows = if rows.contains("never") { rows.replace("0,0", "noon,0") } else { rows };
            std::fs::write(&path, header.to_owned() + &rows).unwrap();
            let clip = read(&path, None).unwrap();
            assert!((clip.fps / fps - 1.0).abs() < 0.02, "{header}{rows}: {} fps", clip.fps);
            assert_eq!(clip.frame_count(), rows.lines().count());
            assert_eq!(read(&path, Some(12.0)).unwrap().fps, 12.0);
        }
        // A row that was lost, and one that is twice there.
        std::fs::write(&path, "time,a\n0,0\n0.1,1\n0.2,2\n0.6,6\n0.6,6\n0.7,7\n0.8,8\n").unwrap();
        let clip = read(&path, None).unwrap();
        assert!((clip.fps - 10.0).abs() < 1e-4 && clip.frame_count() == 9, "{clip:?}");
        assert!((0..9).all(|frame| (clip.values[2 * frame + 1] - frame as f32).abs() < 1e-4), "{clip:?}");
    }
}
