//! Weight clips from CSV: a header of target names, then one row of weights per frame.
//!
//! The frame rate is given by the caller, or stated by a column of times, or part of the file's name
//! (`walk_30fps.csv`).

mod times;

pub use super::DEFAULT_FPS;
use crate::error::{Error, Result, ensure, listed, refuse, shortened};
use crate::import::kinds::refuse_others;
use crate::import::stem;
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
/// comments; these, spaces around names and numbers, empty lines and a byte order mark are ignored. An empty cell, or
/// one that says so (`NA`, `null`, `nan`), has the weight before it in its column, or 0. A last row that ends early is
/// left out.
///
/// Weights may be any finite numbers, also below 0 and above 1. A column without a name is called after its number,
/// `column 3`. A column without any number, such as timecode, holds NaN, which [`WeightClip::bind`] refuses: like other
/// columns that name no target, [`WeightClip::bind`] leaves it out. A header without rows is a clip of 0 frames.
///
/// The frame rate is `fps`; `None` takes the one that a column of times states, called `time`, `timestamp`, `Timecode`
/// or the like: rows that are not evenly spaced become frames that are, by interpolation. Without such a column it is
/// the one in the file's name, the number before the last "fps" in it (`walk_30fps.csv`), or else [`DEFAULT_FPS`].
/// Where no times are, frames that a column `frame` or the like leaves out are interpolated. [`WeightClip::notes`] says
/// what was left out, interpolated or assumed.
///
/// Takes 200 bytes of memory at most for each byte of the file, and 1 MiB, whatever it counts.
///
/// # Errors
/// [`Error::Io`] if the file cannot be read, [`Error::Input`] with line and column if it is not such a CSV,
/// [`Error::Invalid`] if `fps` is not a positive number, [`Error::OutOfMemory`].
pub fn read(path: &Path, fps: Option<f32>) -> Result<WeightClip> {
    let bytes = read_bounded(path, TEXT_MAX, "split the clip")?;
    let given = fps.map(super::frame_rate).transpose()?;
    let mut table = Table::parse(path, &bytes)?;
    let timed = times::space(&mut table, given.is_some())?;
    let Table { names, values, mut notes, .. } = table;
    let stated = given.or(timed).or_else(|| fps_of_name(path));
    let clock = names.iter().enumerate().find(|(column, name)| is_time(name, *column));
    if let (None, Some((_, name)), true) = (stated, clock, values.len() > names.len()) {
        let name = shortened(name);
        notes.push(format!("column '{name}' gives no frame rate: {DEFAULT_FPS} a second is assumed; give --fps"));
    }
    let fps = stated.unwrap_or(DEFAULT_FPS);
    Ok(WeightClip { name: stem(path), names, fps, values, notes })
}

/// Most columns that are taken for times.
const CLOCKS: usize = 8;

/// What a CSV holds.
struct Table {
    names: Vec<String>,
    /// Row after row.
    values: Vec<f32>,
    /// The first columns of times, and those; none of one that could not be read.
    clocks: Vec<(usize, Vec<Time>)>,
    notes: Vec<String>,
}

impl Table {
    fn parse(path: &Path, bytes: &[u8]) -> Result<Self> {
        refuse_others(path, bytes, "a CSV file")?;
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
        // Flexible, since a ragged row is refused below, with its line.
        let mut reader = ReaderBuilder::new();
        reader.has_headers(false).flexible(true).trim(Trim::All).comment(Some(b'#')).delimiter(separator);
        let mut reader = reader.from_reader(&text.as_bytes()[header..]);
        let mut record = StringRecord::new();
        let mut table = Self { names: vec![], values: vec![], clocks: vec![], notes: vec![] };
        let mut kinds: Vec<Kind> = vec![];
        let mut least = 0;
        // Reading from text in memory, with rows of any length, cannot fail.
        while reader.read_record(&mut record).map_err(|_| refuse(header, "", undecoded, "save it again"))? {
            // The reader's position is that of line breaks before the record.
            let at = header + record.position().map_or(0, |position| position.byte() as usize);
            let at = at + bytes[at..].iter().take_while(|b| matches!(b, b'\r' | b'\n')).count();
            if table.names.is_empty() {
                table.names = names(&record).map_err(|(what, remedy)| refuse(at, "", what, remedy))?;
                let is_clock = |(column, name): &(usize, &String)| is_time(name, *column);
                let clocks = table.names.iter().enumerate().filter(is_clock).take(CLOCKS);
                table.clocks = clocks.map(|(column, _)| (column, vec![])).collect();
                // A last comma may be in the header alone.
                least = record.len() - usize::from(record.len() > 1 && record[record.len() - 1].is_empty());
                kinds.resize(record.len(), Kind::default());
                continue;
            }
            let columns = table.names.len();
            let fits = record.len() >= least && record.iter().skip(columns).all(str::is_empty);
            let what = || format!("values in the row: {}, but columns in the header: {columns}", record.len());
            let is_last = || !bytes[at..].trim_ascii_end().contains(&b'\n');
            if record.len() < least && is_last() {
                table.notes.push(format!("line {}, the last one, is left out: {}", line(at), what()));
                break;
            }
            ensure!(fits, refuse(at, "", &what(), "give one value per column in every row"));
            let what = || format!("{}: line {}: there is no memory for more rows", path.display(), line(at));
            let has_room = table.values.try_reserve(columns).is_ok();
            ensure!(has_room, Error::out_of_memory(what(), "split the clip"));
            for (i, kind) in kinds.iter_mut().enumerate() {
                let cell = record.get(i).unwrap_or_default();
                let weight = match number(cell) {
                    Some(weight) if !weight.is_nan() => {
                        let what = || format!("the weight '{cell}' is not a finite number");
                        let remedy = "replace it with a finite number";
                        ensure!(weight.is_finite(), refuse(at, &table.names[i], &what(), remedy));
                        kind.has_numbers = true;
                        weight
                    }
                    _ if is_missing(cell) => {
                        kind.missing += 1;
                        kind.has_words |= !cell.is_empty();
                        table.values.len().checked_sub(columns).map_or(0.0, |before| table.values[before])
                    }
                    _ => {
                        kind.text.get_or_insert_with(|| (at, shortened(cell)));
                        f32::NAN
                    }
                };
                table.values.push(weight);
            }
            let before = table.values.len() / columns - 1;
            for (column, times) in table.clocks.iter_mut().filter(|(_, times)| times.len() == before) {
                let cell = record.get(*column).unwrap_or_default();
                let held = times.last().copied().filter(|_| is_missing(cell));
                match Time::read(cell, times.last()).or(held) {
                    Some(time) if times.try_reserve(1).is_ok() => times.push(time),
                    // Times that cannot be read are no times.
                    _ => times.clear(),
                }
            }
        }
        let remedy = "give a header of target names and one row per frame";
        ensure!(!table.names.is_empty(), Error::input(path, "", "an empty file", remedy));
        // A column of text alone is none of weights, unless no other is.
        let is_clock = |i: usize| table.clocks.iter().any(|(column, times)| *column == i && !times.is_empty());
        let all_text = !kinds.iter().any(|kind| kind.has_numbers);
        let cells = kinds.iter().enumerate().filter(|(i, kind)| kind.has_numbers || all_text && !is_clock(*i));
        let first = cells.filter_map(|(i, kind)| Some((kind.text.as_ref()?, i))).min();
        if let Some(((at, cell), i)) = first {
            let what = format!("'{cell}' is not a number");
            return Err(refuse(*at, &table.names[i], &what, "write weights as decimal numbers"));
        }
        let held = kinds
            .iter()
            .zip(&table.names)
            .filter(|(kind, _)| kind.missing > 0 && (kind.has_numbers || kind.has_words && kind.text.is_none()));
        let (counts, names): (Vec<_>, Vec<_>) = held.map(|(kind, name)| (kind.missing, name.as_str())).unzip();
        if !names.is_empty() {
            let count: usize = counts.iter().sum();
            table
                .notes
                .push(format!("missing values, which stay as in the row before: {count}, in {}", listed(&names)));
        }
        Ok(table)
    }
}

/// What the cells of a column hold.
#[derive(Clone, Debug, Default)]
struct Kind {
    has_numbers: bool,
    /// Whether a cell says in a word that it has no value.
    has_words: bool,
    /// Number of cells without a value.
    missing: usize,
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

/// The names of columns, or what is wrong, and the remedy.
fn names(header: &StringRecord) -> Result<Vec<String>, (&'static str, &'static str)> {
    let mut seen = HashSet::new();
    let is_twice = header.iter().any(|name| !name.is_empty() && !seen.insert(name));
    let stated = || header.iter().filter(|name| !name.is_empty());
    // Numbers may be names, but not those of weights or times.
    let is_counted = |name: &&str| name.bytes().all(|b| b.is_ascii_digit());
    let numbers: Vec<&str> = stated().filter(|name| number(name).is_some()).collect();
    // All, or all but the first.
    let many = numbers.len() + 1 >= stated().count() && !numbers.is_empty();
    if many && (is_twice || !numbers.iter().all(is_counted)) || header.get(0) == Some("---") {
        let what = "numbers where the header is expected: names are missing, or rows are curves and columns times";
        return Err((what, "name each column after its target, and give a row for each frame"));
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

/// Whether a cell is empty, or says so in the word of some language.
fn is_missing(cell: &str) -> bool {
    let word: String = cell.chars().filter(|c| c.is_alphanumeric()).collect();
    let words = ["", "na", "nan", "null", "none", "nil", "missing", "undefined", "1qnan", "1ind", "nanind"];
    words.iter().any(|missing| word.eq_ignore_ascii_case(missing))
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
            (b"a,b\n1,2\n3\n4,5\n", "w.csv: line 3: values in the row: 1, but columns in the header: 2"),
            (b"a,b\n1,2\n3,x1\n", "column 'b', line 3: 'x1' is not a number"),
            (b"a,b\n1,-inf\n", "column 'b', line 2: the weight '-inf' is not a finite"),
            (b"a,b\n1e99,0\n", "column 'a', line 2"),
            (b"\n0.5,0.25\n0,1\n", "w.csv: line 2: numbers where the header is expected"),
            (b"0,1,0\n", "line 1: numbers where the header is expected"),
            (b"\xef\xbb\xbf {\"exportFps\": 60}", "w.csv: JSON, where a CSV file is expected"),
            (b"a,b\nx,y\n", "column 'a', line 2: 'x' is not a number"),
            (b"time,a\n00:01,\n00:02,no\n", "column 'a', line 3: 'no' is not a number"),
            (b"a;b\n1;2\n1,5;1.5,0\n", "column 'b', line 3: '1.5,0' is not a number"),
            (b"a,b,\n1,2,3,4\n", "line 2: values in the row: 4, but columns in the header: 3"),
            (b"a,b\r\n1,2\r\n\r\n3\r\n4,5", "line 4"),
            (
                b"---,0.0,0.033\nJawOpen,0,1\n",
                "line 1: numbers where the header is expected: names are missing, or rows are curves",
            ),
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
        let none = ["walk.csv", "fps.csv", "_fps.csv", "a_0fps.csv", "a_inffps.csv", "a_1.2.3fps.csv", "30/fps.csv"];
        assert_eq!(none.map(of), [None; 7]);
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
        let names = vec!["a".into(), "b,\"c".into()];
        let clip = WeightClip { name: "talk_24fps".into(), names, fps: 24.0, values, notes: vec![] };
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
            let bound = clip.bind(&["jawOpen", "smile"]).unwrap();
            assert_eq!(bound.frames().collect::<Vec<_>>().concat(), plain.values, "{text:?}");
            let notes = bound.notes.join("; ");
            let lost = notes.split_once(" no target is called so: ").map_or("", |(_, names)| names);
            assert_eq!(lost, listed(others), "{text:?}");
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
            // Offsets, AM and PM past noon, units, a second column, another day, milliseconds of the second.
            ("timestamp,a\n", "2026-05-01T10:00:00.0+02:00,0\n2026-05-01T10:00:00.5+02:00,1\n".to_owned(), 2.0),
            ("Time,a\n", "12:59:59.75 PM,0\n1:00:00.0 PM,1\n01:00:00.25 PM,2\n".to_owned(), 4.0),
            ("Timecode,a\n", "23:59:59:58,0\n23:59:59:59,1\n00:00:00:00,2\n".to_owned(), 60.0),
            ("time,a\n", "0 s,0\n2.5 s,1\n5 s,2\n".to_owned(), 0.4),
            ("timestamp_ms,a\n", "0,0\n2000,1\n4000,2\n".to_owned(), 0.5),
            ("start_time,time,a\n", "7,0.0,0\n7,0.02,1\n7,0.04,2\n".to_owned(), 50.0),
            ("t,a\n", "0,0\n.02,1\n.04,2\n".to_owned(), 50.0),
            ("Timecode,a\n", (0..50).map(|i| format!("0:0:0:{i:02}.{:03},{i}\n", i * 1000 / 60)).collect(), 60.0),
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

    #[test]
    fn what_was_left_out_or_assumed_is_said() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("take.csv");
        for (text, values, note) in [
            (
                "a\n1\nNA\nnull\n-\n<N/A>\nNaN\n2\n",
                &[1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0][..],
                "missing values, which stay as in the row before: 5, in 'a'",
            ),
            ("a,b\n1,2\n3,", &[1.0, 2.0, 3.0, 2.0], "row before: 1, in 'b'"),
            ("a,b\n1,nan\n", &[1.0, 0.0], "row before: 1, in 'b'"),
            ("a,b\n1,2\n3\n", &[1.0, 2.0], "line 3, the last one, is left out: values in the row: 1, but columns"),
            (
                "frame,a\n7,0\n8,1\n10,3\n",
                &[7.0, 0.0, 8.0, 1.0, 9.0, 2.0, 10.0, 3.0],
                "column 'frame': 4 frames are interpolated from 3",
            ),
            (
                "time,a\n1,0\n2,1\n4,3\n",
                &[1.0, 0.0, 2.0, 1.0, 3.0, 2.0, 4.0, 3.0],
                "column 'time' gives no frame rate: 30",
            ),
            ("frame,a\n0,0\n2,1\n4,3\n", &[0.0, 0.0, 2.0, 1.0, 4.0, 3.0], ""),
            ("time,a\n5,0\n3,1\n", &[5.0, 0.0, 3.0, 1.0], "column 'time' gives no frame rate: 30"),
            ("time,a\n0,0\n2.5,1\n", &[0.0, 0.0, 2.5, 1.0], "column 'time' gives 400 frames a second"),
            // Two faces: the second of a frame.
            (
                "timestamp,a\n0,0\n0,1\n.5,2\n.5,3\n1,4\n1,5\n",
                &[0.0, 1.0, 0.5, 3.0, 1.0, 5.0],
                "3 frames are interpolated from 6 rows",
            ),
            ("time,time,a\n0,0,1\n.5,.5,2\n", &[0.0, 0.0, 1.0, 0.5, 0.5, 2.0], ""),
        ] {
            std::fs::write(&path, text).unwrap();
            let clip = read(&path, None).unwrap_or_else(|e| panic!("{text:?}: {e}"));
            assert_eq!(clip.values, values, "{text:?}");
            let notes = clip.notes.join("; ");
            assert!(notes.contains(note) && notes.is_empty() == note.is_empty(), "{text:?}: {notes}");
        }
        // Frames stay those of the column where the rate is given.
        std::fs::write(&path, "frame,a\n0,0\n1,1\n3,3\n").unwrap();
        assert_eq!(read(&path, Some(60.0)).unwrap().frame_count(), 4);
    }
}
