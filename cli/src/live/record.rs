//! The weights that arrive, as a clip.

use crate::output::Failure;
use deltamorph::import::csv as clips;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A clip that is being written, a row of weights at a time.
pub struct Recorder {
    path: PathBuf,
    file: csv::Writer<BufWriter<File>>,
    fps: f64,
    begun: Option<Instant>,
    pub rows: u64,
}

impl Recorder {
    /// Begins a clip of these sliders at the rate of `fps`, or the one that its name says.
    pub fn new(path: &Path, names: &[String], fps: Option<f32>) -> Result<Self, Failure> {
        let mut file =
            csv::Writer::from_writer(BufWriter::new(File::create(path).map_err(|e| Failure::io(path, "write", e))?));
        let written =
            file.write_record(names).map_err(Failure::failed).and_then(|()| file.flush().map_err(Failure::failed));
        written?;
        let fps = f64::from(clips::read(path, fps)?.fps);
        Ok(Self { path: path.to_owned(), file, fps, begun: None, rows: 0 })
    }

    /// Writes the weights for the time since the last row, from the first frame that was heard on.
    pub fn write(&mut self, heard: bool, values: &[f32]) -> Result<(), Failure> {
        if !heard && self.begun.is_none() {
            return Ok(());
        }
        let due = self.begun.get_or_insert_with(Instant::now).elapsed().as_secs_f64() * self.fps;
        while self.rows as f64 <= due {
            let row = values.iter().map(f32::to_string);
            self.file.write_record(row).map_err(|e| Failure::Failed(format!("{}: {e}", self.path.display())))?;
            self.rows += 1;
        }
        Ok(())
    }

    pub fn finish(&mut self) -> Result<(), Failure> {
        self.file.flush().map_err(|e| Failure::io(&self.path, "write", e))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn a_recording_is_a_clip_at_the_rate_of_its_name() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("heard_100fps.csv");
        let mut recorder = Recorder::new(&path, &["jawOpen".into(), "a, b".into()], None).expect("a file");
        recorder.write(false, &[1.0, 1.0]).expect("nothing was heard yet");
        assert_eq!(recorder.rows, 0);
        recorder.write(true, &[0.25, 0.0]).expect("a row");
        std::thread::sleep(Duration::from_millis(60));
        recorder.write(false, &[0.5, 1.0]).expect("rows");
        recorder.finish().expect("a file");
        let clip = clips::read(&path, None).expect("a clip");
        assert_eq!((clip.fps, clip.names), (100.0, vec!["jawOpen".into(), "a, b".into()]));
        assert_eq!((&clip.values[..2], &clip.values[12..14]), (&[0.25, 0.0][..], &[0.5, 1.0][..]));
        assert!(Recorder::new(&folder.path().join("no/folder.csv"), &[], None).is_err());
    }
}
