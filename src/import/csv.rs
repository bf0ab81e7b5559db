//! Weight clips from CSV: a header of target names, then one row of weights per frame.
//!
//! There is no time column: the frame rate is given by the caller, or part of the file's name (`walk_30fps.csv`).

pub use super::DEFAULT_FPS;
use crate::error::{Error, Result};
use crate::io::{TEXT_MAX, read_bounded, write_replacing};
use crate::weights::WeightClip;
use csv::{Position, ReaderBuilder, StringRecord, Trim};
use std::collections::HashSet;
use std::path::Path;

/// Reads a weights CSV: a header of target names, then one row per frame.
///
/// Spaces around names and numbers, empty lines and a byte order mark are ignored. Weights may be any finite numbers,
/// also below 0 and above 1. A header without rows is a clip of 0 frames. The frame rate is `fps`; `None` takes the one
/// in the file's name, the number before the last "fps" in it (`walk_30fps.csv`), or else [`DEFAULT_FPS`].
///
/// Takes 200 bytes of memory at most for each byte of the file, and 1 MiB, whatever it counts.
///
/// # Errors
/// [`Error::Io`] if the file cannot be read, [`Error::Input`] with line and column if it is not such a CSV,
/// [`Error::Invalid`] if `fps` is not a positive number, [`Error::OutOfMemory`].
pub fn read(path: &Path, fps: Option<f32>) -> Result<WeightClip> {
    let bytes = read_bounded(path, TEXT_MAX, "split the clip")?;
    let name = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let fps = super::frame_rate(fps.or_else(|| fps_of_name(path)).unwrap_or(DEFAULT_FPS))?;
    let (names, values) = parse(path, bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes))?;
    Ok(WeightClip { name, names, fps, values })
}

/// Names and values, row after row.
fn parse(path: &Path, text: &[u8]) -> Result<(Vec<String>, Vec<f32>)> {
    // Flexible, since a ragged row is refused below, with its line.
    let mut reader = ReaderBuilder::new().has_headers(false).flexible(true).trim(Trim::All).from_reader(text);
    let mut record = StringRecord::new();
    let mut names = Vec::<String>::new();
    let mut values = vec![];
    let refuse_at = |at: Option<&Position>, column: &str, what: &str, remedy: &str| {
        let column = if column.is_empty() { String::new() } else { format!("column '{column}', ") };
        Error::input(path, format!(": {column}line {}", line_at(text, at)), what, remedy)
    };
    // Reading from memory, with rows of any length, can fail in no other way.
    let undecoded =
        |e: csv::Error| refuse_at(e.position(), "", "bytes that are not UTF-8 text", "save the file as CSV in UTF-8");
    while reader.read_record(&mut record).map_err(undecoded)? {
        let refuse = |column: &str, what: &str, remedy| Err(refuse_at(record.position(), column, what, remedy));
        if names.is_empty() {
            // A single column: another character was probably meant as separator.
            if let Some(by) = [';', '\t'].into_iter().find(|by| record.len() == 1 && record[0].contains(*by)) {
                return refuse("", &format!("one column, whose name has {by:?} in it"), "separate columns by commas");
            }
            let mut seen = HashSet::new();
            for (i, name) in record.iter().enumerate() {
                if name.is_empty() {
                    let what = format!("column {} of the header has no name", i + 1);
                    return refuse("", &what, "name every column after its target");
                }
                if !seen.insert(name) {
                    return refuse(name, "the second column of this name", "rename or remove one of them");
                }
            }
            names = record.iter().map(str::to_owned).collect();
            continue;
        }
        if record.len() != names.len() {
            let what = format!("{} values, but the header has {} columns", record.len(), names.len());
            return refuse("", &what, "give one value per column in every row");
        }
        if values.try_reserve(names.len()).is_err() {
            let line = line_at(text, record.position());
            let what = format!("{}: line {line}: there is no memory for more rows", path.display());
            return Err(Error::out_of_memory(what, "split the clip"));
        }
        for (name, value) in names.iter().zip(&record) {
            let Ok(weight) = value.parse::<f32>() else {
                let what = format!("'{}' is not a number", value.chars().take(40).collect::<String>());
                return refuse(name, &what, "write weights as decimal numbers with a point");
            };
            if !weight.is_finite() {
                let what = format!("the weight '{value}' is not a finite number");
                return refuse(name, &what, "replace it with a finite number");
            }
            values.push(weight);
        }
    }
    if names.is_empty() {
        return Err(Error::input(path, "", "an empty file", "give a header of target names and one row per frame"));
    }
    Ok((names, values))
}

/// The line of a record. The csv crate's own line count lags behind after CR LF and empty lines.
fn line_at(text: &[u8], position: Option<&Position>) -> usize {
    let byte = position.map_or(0, Position::byte);
    let at = usize::try_from(byte).unwrap_or(text.len()).min(text.len());
    let breaks = text[at..].iter().take_while(|b| matches!(b, b'\r' | b'\n')).count();
    1 + text[..at + breaks].iter().filter(|&&b| b == b'\n').count()
}

/// Returns the frames per second that a file's name states: the number before the last "fps" in it, as in
/// `walk_30fps.csv` or `Walk_29.97FPS_take2.csv`.
fn fps_of_name(path: &Path) -> Option<f32> {
    let stem = path.file_stem()?.to_str()?.to_ascii_lowercase();
    let (before, _) = stem.rsplit_once("fps")?;
    let words = before.trim_end_matches(|c: char| c.is_ascii_digit() || c == '.');
    let number = &before[words.len()..];
    number.parse().ok().filter(|fps: &f32| *fps > 0.0 && fps.is_finite())
}

/// Writes a weights CSV that [`read`] reads back unchanged, except for the frame rate, which only a name like
/// `walk_30fps.csv` can carry.
///
/// # Errors
/// [`Error::Invalid`] if the clip has no columns, two of one name, a name that does not read back (empty, with spaces
/// around it, or with a byte order mark first), or a weight that is not finite; [`Error::Io`] if the file cannot be
/// written.
pub fn write(path: &Path, clip: &WeightClip) -> Result<()> {
    clip.check()?;
    if clip.names.is_empty() {
        return Err(Error::invalid(format!("clip '{}' has no columns", clip.name), "give it a column per target"));
    }
    if let Some(name) = clip.names.iter().find(|n| n.is_empty() || n.trim() != n.as_str() || n.starts_with('\u{feff}'))
    {
        let what = format!(
            "clip '{}': the column name '{name}' is empty, has spaces around it, or begins with a byte order mark",
            clip.name
        );
        return Err(Error::invalid(what, "rename the column"));
    }
    write_replacing(path, |out| {
        let mut out = csv::Writer::from_writer(out);
        out.write_record(&clip.names)?;
        for row in clip.values.chunks_exact(clip.names.len()) {
            out.write_record(row.iter().map(f32::to_string))?;
        }
        out.flush()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_name_file_line_and_column() {
        for (text, expected) in [
            (&b""[..], "w.csv: an empty file"),
            (b"a,b\n1,2\n3\n", "w.csv: line 3: 1 values, but the header has 2 columns"),
            (b"a,b\n1,2\n3,x1\n", "column 'b', line 3: 'x1' is not a number"),
            (b"a,b\n1,NaN\n", "column 'b', line 2: the weight 'NaN' is not a finite"),
            (b"a,b\n1e99,0\n", "column 'a', line 2"),
            (b"a,b,a\n", "column 'a', line 1: the second column"),
            (b"a,,b\n", "column 2 of the header"),
            (b"a;b\n", "line 1: one column, whose name has ';' in it"),
            (b"a,b\r\n1,2\r\n\r\n3\r\n", "line 4"),
            (b"a,b\n1,\xe9\n", "w.csv: line 2: bytes that are not UTF-8"),
        ] {
            crate::testing::says(parse(Path::new("w.csv"), text), &[expected]);
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
        let (names, values) = parse(Path::new("w.csv"), b" a ,\"b,c\"\r\n0.5,-2\r\n\r\n 1e-3 ,3.5").unwrap();
        assert_eq!((names, values), (vec!["a".to_owned(), "b,c".to_owned()], vec![0.5, -2.0, 0.001, 3.5]));
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
}
