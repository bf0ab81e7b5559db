//! A whole clip.

use super::Pose;
use super::canvas::{encoder, save, straight};
use super::easel::Easel;
use crate::output::{Failure, Output, Result, publish, write_file};
use std::path::Path;

/// Whether a clip is written as one file, an animated PNG, rather than into a folder.
pub fn is_one_file(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png") || e.eq_ignore_ascii_case("apng"))
}

/// Draws the frames in this size, of a clip of `fps` frames per second.
pub fn draw(
    easel: &mut Easel<'_>,
    frames: &[Pose],
    (size, fps): ([u32; 2], f32),
    output: &Path,
    out: &Output,
) -> Result<()> {
    let bar = out.bar(frames.len() as u64);
    let pictures = frames.iter().map(|[now, _]| {
        bar.inc(1);
        easel.draw(&[now])
    });
    if !is_one_file(output) {
        return publish(output, is_frame, |folder| {
            let name = |i| folder.join(format!("frame_{i:05}.png"));
            pictures.enumerate().try_for_each(|(i, picture)| save(picture?, &name(i)))
        });
    }
    let failed = |e: png::EncodingError| Failure::Failed(format!("{}: cannot be encoded: {e}", output.display()));
    let mut file = vec![];
    let mut encoder = encoder(&mut file, size);
    encoder.set_compression(png::Compression::Fast);
    encoder.set_animated(frames.len() as u32, 0).map_err(failed)?;
    // A fraction of two 16-bit numbers.
    encoder.set_frame_delay((1000.0 / fps.max(0.016)).round() as u16, 1000).map_err(failed)?;
    let mut writer = encoder.write_header().map_err(failed)?;
    for picture in pictures {
        writer.write_image_data(&straight(picture?).rgba).map_err(failed)?;
    }
    writer.finish().map_err(failed)?;
    write_file(output, file)
}

/// Whether a file of the folder was written by an earlier run.
fn is_frame(name: &str) -> bool {
    let number = name.strip_prefix("frame_").and_then(|rest| rest.strip_suffix(".png"));
    number.is_some_and(|number| number.len() >= 5 && number.bytes().all(|b| b.is_ascii_digit()))
}
