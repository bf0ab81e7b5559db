//! Weight clips in packed files, beside the mesh.
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

use super::table::{counted, name_of, push_name, u32_of};
use crate::error::{Result, ensure};
use crate::weights::WeightClip;

fn check(clip: &WeightClip) -> Result<()> {
    clip.check()?;
    let what = format!("clip '{}': the frame rate is {}", clip.name, clip.fps);
    ensure!(clip.fps > 0.0 && clip.fps.is_finite(), what, "give a positive number of frames per second");
    Ok(())
}

/// The section of these clips.
pub(super) fn write(clips: &[WeightClip]) -> Result<Vec<u8>> {
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
    Ok(out)
}

/// The clips of a section; none of an empty one. Takes 24 times its size in memory at most.
pub(super) fn read(mut rest: &[u8]) -> Result<Vec<WeightClip>, String> {
    let mut clips = vec![];
    if rest.is_empty() {
        return Ok(clips);
    }
    for i in 0..u32_of(&mut rest)? {
        let clip = clip(&mut rest).map_err(|what| format!("{what}, in clip {i}"))?;
        check(&clip).map_err(|e| e.to_string())?;
        clips.push(clip);
    }
    ensure!(rest.is_empty(), format!("has {} bytes after the last clip", rest.len()));
    Ok(clips)
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
    use crate::pack::{DeltaFormat, PackDesc, PackedMesh, file};
    use crate::testing;

    fn made() -> [WeightClip; 2] {
        let names = vec!["jawOpen".to_owned(), "é".to_owned()];
        let talk =
            WeightClip { name: "talk".into(), names, fps: 24.0, values: vec![0.5, -1.0, 0.25, 1.5], notes: vec![] };
        [talk, WeightClip { name: "still".into(), fps: 30.0, ..WeightClip::default() }]
    }

    #[test]
    fn clips_are_kept_beside_the_mesh() {
        let mut mesh = PackedMesh::pack(&testing::mesh(10, 2), &PackDesc::new(DeltaFormat::Fast)).unwrap();
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("face.dmorph");
        for (clips, version) in [(vec![], 6), (made().to_vec(), 7)] {
            mesh.clips = clips;
            mesh.write(&path).unwrap();
            assert_eq!(PackedMesh::read(&path).unwrap(), mesh);
            let bytes = std::fs::read(&path).unwrap();
            assert_eq!((bytes[8], file::clips(&path, &bytes).unwrap()), (version, mesh.clips.clone()));
        }
        // Damaged clips cost no more than themselves.
        let mut bytes = std::fs::read(&path).unwrap();
        let at = bytes.windows(4).position(|four| four == b"talk").unwrap();
        bytes[at] ^= 1;
        let damaged = PackedMesh::from_bytes(&path, &bytes).unwrap();
        testing::says(Err::<(), _>(damaged.notes.join("\n")), &["section 'clips': the checksum", "are left out"]);
        assert_eq!(PackedMesh { notes: vec![], ..damaged }, PackedMesh { clips: vec![], ..mesh.clone() });
        testing::says(file::clips(&path, &bytes), &["section 'clips': the checksum does not match"]);
        for (clip, part) in [
            (WeightClip { fps: 0.0, ..made()[0].clone() }, "the frame rate is 0"),
            (WeightClip { values: vec![f32::NAN; 2], ..made()[0].clone() }, "the weight is NaN"),
        ] {
            mesh.clips = vec![clip];
            testing::says(mesh.write(&path), &[part]);
        }
    }
}
