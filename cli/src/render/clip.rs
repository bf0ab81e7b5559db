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
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

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
    let draw = |sender: SyncSender<Canvas>| -> Result<(), Failure> {
        for weights in &frames {
            bar.inc(1);
            if easel.draw(&[weights])?.is_some_and(|canvas| sender.send(canvas).is_err()) {
                return Ok(());
            }
        }
        for canvas in easel.finish()? {
            if sender.send(canvas).is_err() {
                break;
            }
        }
        Ok(())
    };
    if is_one_file(output) {
        let file = beside(draw, |drawn| animated(drawn, size, frames.len(), fps))?;
        let failed = |e| Failure::Failed(format!("{}: cannot be encoded: {e}", output.display()));
        let file = file.map_err(failed)?;
        write_replacing(output, |out| out.write_all(&file))?;
    } else {
        publish(output, is_frame, |folder| {
            let save = |(i, frame): (usize, Canvas)| frame.save(&folder.join(format!("frame_{i:05}.png")));
            beside(draw, |drawn| drawn.into_iter().enumerate().try_for_each(save))?
        })?;
    }
    drop(bar);
    let what = format!("{} frames at {fps} frames per second", frames.len());
    Ok(Done { what, size, frames: frames.len(), scale })
}

/// Draws with `draw`, and encodes what it sends on another thread.
fn beside<T: Send>(
    draw: impl FnOnce(SyncSender<Canvas>) -> Result<(), Failure>,
    encode: impl FnOnce(Receiver<Canvas>) -> T + Send,
) -> Result<T, Failure> {
    std::thread::scope(|scope| {
        let (sender, frames) = sync_channel(WAITING);
        let encoding = scope.spawn(|| encode(frames));
        let drawn = draw(sender);
        let encoded = encoding.join().map_err(|_| Failure::failed("a frame could not be encoded; report this"))?;
        drawn.map(|()| encoded)
    })
}

/// Encodes frames as one file.
fn animated(frames: Receiver<Canvas>, size: [u32; 2], count: usize, fps: f32) -> Result<Vec<u8>, png::EncodingError> {
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
}

/// Whether a file of the folder was written by an earlier run.
fn is_frame(name: &str) -> bool {
    let number = name.strip_prefix("frame_").and_then(|rest| rest.strip_suffix(".png"));
    number.is_some_and(|number| number.len() >= 5 && number.bytes().all(|b| b.is_ascii_digit()))
}
