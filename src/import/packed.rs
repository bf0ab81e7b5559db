//! Weight clips in packed files (`.dmorph`), beside the mesh.
//!
//! Section 'clips' of such a file, little-endian, without padding:
//!
//! ```text
//! number of clips u32, then for each clip
//!     name   frames per second f32   columns u32   frames u32
//!     [column] name
//!     [frame][column] weight f32
//! a name is its length in bytes u32, and UTF-8
//! ```

use crate::error::{Error, Result, ensure};
use crate::import::kinds::refuse_others;
use crate::io::write_replacing;
use crate::pack::file::table::{counted, name_of, push_name, u32_of};
use crate::pack::file::{self, Asset};
use crate::weights::WeightClip;
use std::io::Write;
use std::path::Path;

/// Writes `asset` to the file `path`, with weight clips, which [`open_clip`](super::open_clip) reads from it. Without
/// clips the file is that of [`Asset::write`].
///
/// # Errors
/// Those of [`Asset::write`]; [`Error::Invalid`] for a clip that [`WeightClip::bind`] refuses whatever the targets are
/// called, that has no positive frame rate, or 2³² columns or more.
pub fn write(path: &Path, asset: &Asset, clips: &[WeightClip]) -> Result<()> {
    let bytes = to_bytes(asset, clips)?;
    write_replacing(path, |out| out.write_all(&bytes))
}

/// Returns the bytes of the file that [`write()`] writes.
///
/// # Errors
/// Those of [`Asset::to_bytes`]; [`Error::Invalid`] for a clip, as in [`write()`].
pub fn to_bytes(asset: &Asset, clips: &[WeightClip]) -> Result<Vec<u8>> {
    asset.to_bytes_with(section(clips)?)
}

/// Reads the clips of the file `path`.
///
/// # Errors
/// [`Error::Io`] if the file cannot be read; [`Error::Input`] if it is not a packed file, or its clips are not valid.
pub fn clips(path: &Path) -> Result<Vec<WeightClip>> {
    clips_from_bytes(path, &file::bytes(path)?)
}

/// Reads the clips of a file from memory; `path` is used only in messages. Takes 24 times the size of the section at
/// most.
///
/// # Errors
/// [`Error::Input`] if `bytes` are not a packed file, or its clips are not valid.
pub fn clips_from_bytes(path: &Path, bytes: &[u8]) -> Result<Vec<WeightClip>> {
    let refuse = |what: String| {
        let remedy = "the program that wrote it is at fault: pack the mesh again";
        Error::input(path, ": section 'clips'", what, remedy)
    };
    refuse_others(path, bytes, "a packed mesh")?;
    let mut rest = file::clips(path, bytes)?;
    let mut clips = vec![];
    if rest.is_empty() {
        return Ok(clips);
    }
    for i in 0..u32_of(&mut rest).map_err(refuse)? {
        let clip = clip(&mut rest).map_err(|what| refuse(format!("{what}, in clip {i}")))?;
        check(&clip).map_err(|e| refuse(e.to_string()))?;
        clips.push(clip);
    }
    ensure!(rest.is_empty(), refuse(format!("has {} bytes after the last clip", rest.len())));
    Ok(clips)
}

fn check(clip: &WeightClip) -> Result<()> {
    clip.check()?;
    let what = format!("clip '{}': the frame rate is {}", clip.name, clip.fps);
    ensure!(super::is_rate(clip.fps), what, "give a positive number of frames per second");
    Ok(())
}

/// The content of section 'clips'; `None` without clips.
fn section(clips: &[WeightClip]) -> Result<Option<Vec<u8>>> {
    let mut out = vec![];
    out.extend(counted(clips.len())?.to_le_bytes());
    for clip in clips {
        check(clip)?;
        push_name(&mut out, &clip.name)?;
        out.extend(clip.fps.to_le_bytes());
        out.extend(counted(clip.names.len())?.to_le_bytes());
        out.extend(counted(clip.frame_count())?.to_le_bytes());
        clip.names.iter().try_for_each(|name| push_name(&mut out, name))?;
        out.extend(clip.values.iter().flat_map(|weight| weight.to_le_bytes()));
    }
    Ok((!clips.is_empty()).then_some(out))
}

fn clip(rest: &mut &[u8]) -> Result<WeightClip, String> {
    let name = name_of(rest)?.to_owned();
    let fps = f32::from_bits(u32_of(rest)?);
    let [columns, frames] = [u32_of(rest)?, u32_of(rest)?];
    ensure!(columns > 0 || frames == 0, format!("states {frames} frames without columns"));
    let mut names = vec![];
    for _ in 0..columns {
        names.push(name_of(rest)?.to_owned());
    }
    let bytes = u64::from(columns) * u64::from(frames) * 4;
    let values = usize::try_from(bytes).ok().and_then(|bytes| rest.split_off(..bytes));
    let values = values.ok_or_else(|| format!("ends before {frames} frames of {columns} weights"))?;
    let values = values.as_chunks().0.iter().map(|weight| f32::from_le_bytes(*weight)).collect();
    Ok(WeightClip { name, names, fps, values, ..WeightClip::default() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pack::{DeltaFormat, PackDesc};
    use crate::testing;

    fn made() -> (Asset, [WeightClip; 2]) {
        let asset = Asset::pack(&testing::mesh(10, 2), &PackDesc::new(DeltaFormat::Fast)).unwrap();
        let names = vec!["jawOpen".to_owned(), "é".to_owned()];
        let talk =
            WeightClip { name: "talk".into(), names, fps: 24.0, values: vec![0.5, -1.0, 0.25, 1.5], notes: vec![] };
        (asset, [talk, WeightClip { name: "still".into(), fps: 30.0, ..WeightClip::default() }])
    }

    #[test]
    fn clips_are_kept_beside_the_mesh() {
        let (asset, clips) = made();
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("face.dmorph");
        write(&path, &asset, &clips).unwrap();
        assert_eq!((Asset::read(&path).unwrap(), super::clips(&path).unwrap()), (asset.clone(), clips.to_vec()));
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(bytes[8], 7);
        // Files without clips are those of version 6.
        write(&path, &asset, &[]).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), asset.to_bytes().unwrap());
        assert_eq!((asset.to_bytes().unwrap()[8], super::clips(&path).unwrap()), (6, vec![]));
        let opened = super::super::open(&path, &Default::default()).unwrap();
        assert!(opened.clips.is_empty());
        for (clip, part) in [
            (WeightClip { fps: 0.0, ..clips[0].clone() }, "the frame rate is 0"),
            (WeightClip { values: vec![f32::NAN; 2], ..clips[0].clone() }, "the weight is NaN"),
        ] {
            testing::says(write(&path, &asset, &[clip]), &[part]);
        }
    }

    #[test]
    fn damaged_clips_are_refused() {
        let (asset, clips) = made();
        let good = section(&clips).unwrap().unwrap();
        let read = |section: Vec<u8>| {
            let bytes = asset.to_bytes_with(Some(section)).unwrap();
            let mut result = None;
            let memory =
                allocation_counter::measure(|| result = Some(clips_from_bytes("face.dmorph".as_ref(), &bytes)));
            assert!(memory.bytes_max <= 24 * bytes.len() as u64, "{}", memory.bytes_max);
            result.unwrap()
        };
        assert_eq!(read(good.clone()).unwrap(), clips);
        for end in 1..good.len() {
            testing::says(read(good[..end].to_vec()), &["face.dmorph: section 'clips': ", "pack the mesh again"]);
        }
        testing::says(read([&good[..], &[0]].concat()), &["has 1 bytes after the last clip"]);
        for at in 0..good.len() {
            let mut bytes = good.clone();
            bytes[at] ^= 0xff;
            let _ = read(bytes).map(|clips| clips.iter().for_each(|clip| clip.check().unwrap()));
        }
    }
}
