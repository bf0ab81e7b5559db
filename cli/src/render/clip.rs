//! A whole clip: other threads encode while the device draws ahead.

use super::canvas::{Canvas, encoder};
use super::easel::Easel;
use super::heat;
use super::scenery::{Done, Scenery};
use crate::output::{Failure, publish};
use deltamorph::internals::write_replacing;
use glam::Mat4;
use std::io::Write;
use std::path::Path;
use std::sync::mpsc::sync_channel;

/// Default size of a frame, in pixels.
const SIZE: [u32; 2] = [512; 2];
/// Most frames waiting to be encoded.
const WAITING: usize = 4;

/// Whether a clip is written as one file, an animated PNG, rather than into a folder.
pub fn is_one_file(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png") || e.eq_ignore_ascii_case("apng"))
}

pub fn draw(scenery: &Scenery<'_>, output: &Path) -> Result<Done, Failure> {
    let size = scenery.args.size.unwrap_or(SIZE);
    let (frames, fps) = scenery.frames()?;
    let mut easel = Easel::new(scenery, size, vec![Mat4::IDENTITY])?;
    let scale = heat::prepare(scenery, &mut easel, heat::one_after_the_other(&frames))?;
    let bar = scenery.out.bar(frames.len() as u64);
    let mut all = |send: &mut dyn FnMut(Canvas) -> bool| -> Result<(), Failure> {
        for weights in &frames {
            bar.inc(1);
            if let Some(canvas) = easel.draw(&[weights])?
                && !send(canvas)
            {
                return Ok(());
            }
        }
        for canvas in easel.finish()? {
            if !send(canvas) {
                return Ok(());
            }
        }
        Ok(())
    };
    if is_one_file(output) {
        animated(output, size, frames.len(), fps, &mut all)?;
    } else {
        publish(output, is_frame, |folder| numbered(folder, &mut all))?;
    }
    bar.finish_and_clear();
    let what = format!("{} frames at {fps} frames per second", frames.len());
    Ok(Done { what, size, frames: frames.len(), scale })
}

type All<'a> = dyn FnMut(&mut dyn FnMut(Canvas) -> bool) -> Result<(), Failure> + 'a;

/// Writes one file, encoded on its own thread.
fn animated(path: &Path, size: [u32; 2], count: usize, fps: f32, all: &mut All<'_>) -> Result<(), Failure> {
    let failed = |e: png::EncodingError| Failure::Failed(format!("{}: cannot be encoded: {e}", path.display()));
    std::thread::scope(|scope| {
        let (sender, frames) = sync_channel::<Canvas>(WAITING);
        let encoding = scope.spawn(move || -> Result<Vec<u8>, png::EncodingError> {
            let mut file = vec![];
            let mut encoder = encoder(&mut file, size);
            encoder.set_compression(png::Compression::Fast);
            encoder.set_animated(count as u32, 0)?;
            // A fraction of two 16-bit numbers.
            encoder.set_frame_delay((1000.0 / fps.max(0.016)).round() as u16, 1000)?;
            let mut writer = encoder.write_header()?;
            for frame in frames {
                writer.write_image_data(frame.rgba())?;
            }
            writer.finish()?;
            Ok(file)
        });
        let drawn = all(&mut |frame| sender.send(frame).is_ok());
        drop(sender);
        let file = encoding.join().map_err(|_| Failure::Failed("a frame could not be encoded; report this".into()))?;
        drawn?;
        let file = file.map_err(failed)?;
        Ok(write_replacing(path, |out| out.write_all(&file))?)
    })
}

/// Writes a file for each frame, encoded on several threads.
fn numbered(folder: &Path, all: &mut All<'_>) -> Result<(), Failure> {
    std::thread::scope(|scope| {
        let (sender, frames) = sync_channel::<(usize, Canvas)>(WAITING);
        let writing = scope.spawn(move || {
            frames.into_iter().try_for_each(|(i, frame)| frame.save(&folder.join(format!("frame_{i:05}.png"))))
        });
        let mut number = 0..;
        let drawn = all(&mut |frame| number.next().is_some_and(|i| sender.send((i, frame)).is_ok()));
        drop(sender);
        let written =
            writing.join().map_err(|_| Failure::Failed("a frame could not be written; report this".into()))?;
        drawn.and(written)
    })
}

/// Whether a file of the folder was written by an earlier run.
fn is_frame(name: &str) -> bool {
    let number = name.strip_prefix("frame_").and_then(|rest| rest.strip_suffix(".png"));
    number.is_some_and(|number| number.len() >= 5 && number.bytes().all(|b| b.is_ascii_digit()))
}
