//! Clips as integers, in the form that is uploaded.

use crate::error::{Error, Result, ensure, reserved};
use crate::lod::Importance;
use crate::pack::PackedLayout;
use crate::pack::blocks::PoseGrid;
use crate::plan::instances::out_of_grid;
use crate::weights::WeightClip;

/// Storage of keys.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum KeyFormat {
    /// 32 bits: the resolution of the grid.
    #[default]
    Bits32,
    /// 16 bits, two per word: shifted right until all keys of a clip fit, rounded to nearest. [`Clips::rounding`]
    /// returns the loss.
    Bits16,
}

/// The clips of a crowd animated on the GPU, and its levels of detail.
#[derive(Clone, Copy, Debug)]
pub struct AnimationDesc<'a> {
    /// The clips, numbered from 0 in [`Playback::clip`](super::Playback::clip).
    pub clips: &'a [WeightClip],
    /// Storage of keys.
    pub key_format: KeyFormat,
    /// Order of targets for levels of detail ([`Crowd::set_level`](crate::Crowd::set_level)); `None`:
    /// all targets are always kept.
    pub importance: Option<&'a Importance>,
}

impl<'a> AnimationDesc<'a> {
    /// `clips` with 32-bit keys, without levels of detail.
    pub fn new(clips: &'a [WeightClip]) -> Self {
        Self { clips, key_format: KeyFormat::default(), importance: None }
    }
}

/// Largest absolute key: exact in a float32, and differences fit 32 bits.
const KEY_MAX: i32 = 1 << 24;

/// Properties of a clip outside the table.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Clip {
    fps: f32,
    rounding: f32,
}

/// The clips of an animated crowd as uploaded, with keys rounded to the grid of fixed-point poses. Returned by
/// [`Crowd::clips`](crate::Crowd::clips), to query lengths and rounding; created by
/// [`MorphEngine::create_animated_crowd`](crate::MorphEngine::create_animated_crowd).
///
/// The words that kernels read:
///
/// ```text
/// table   [clip][first word, frames, shift, bits of a key]
/// keys    [clip][frame][target]                                 a word each, or half a word
/// ranks   [target]                                              with AnimationDesc::importance
/// ```
///
/// First words are relative to the start of the table.
#[derive(Clone, Debug, PartialEq)]
pub struct Clips {
    words: Vec<u32>,
    clips: Vec<Clip>,
    targets: usize,
    format: KeyFormat,
    /// First word of the ranks; 0: none.
    ranks_at: u32,
}

/// Words of a clip in the table.
const TABLE_WORDS: usize = 4;

impl Clips {
    /// Rounds the clips of `desc` to the grid, for a mesh.
    ///
    /// # Errors
    /// Errors of [`WeightClip::bind`]; a clip without frames or with an invalid frame rate; a weight beyond the grid
    /// (the message names frame and target); an order of importance for another number of targets.
    #[doc(hidden)]
    pub fn new(desc: &AnimationDesc<'_>, layout: &PackedLayout, grid: PoseGrid) -> Result<Self> {
        let names: Vec<&str> = layout.targets.iter().map(|t| t.name.as_str()).collect();
        let table = TABLE_WORDS * desc.clips.len();
        let count = Self::bytes(desc, layout).div_ceil(4).saturating_add((table + names.len()) as u64);
        let what = format!("clips of {count} words");
        ensure!(u32::try_from(count).is_ok(), what, "make several crowds, or use 16-bit keys");
        let mut words = reserved(count as usize, || what)?;
        words.resize(table, 0);
        let mut all = Self { words, clips: vec![], targets: names.len(), format: desc.key_format, ranks_at: 0 };
        desc.clips.iter().try_for_each(|clip| all.push(clip, &names, grid))?;
        if let Some(importance) = desc.importance {
            let given = importance.order().len();
            let targets = names.len();
            let mesh = &layout.name;
            let what = format!("an order of importance of {given} targets for mesh '{mesh}', which has {targets}");
            ensure!(given == targets, what, "rank the targets of this mesh");
            // 0 without clips, since nothing plays then.
            all.ranks_at = all.words.len() as u32;
            all.words.extend_from_slice(importance.ranks());
        }
        Ok(all)
    }

    /// The size of the keys of `desc`: one of every target in every frame, even if few columns are animated.
    pub(crate) fn bytes(desc: &AnimationDesc<'_>, layout: &PackedLayout) -> u64 {
        let frames: u64 = desc.clips.iter().map(|clip| clip.frame_count() as u64).sum();
        let key = if desc.key_format == KeyFormat::Bits16 { 2 } else { 4 };
        frames.saturating_mul(layout.targets.len() as u64 * key)
    }

    fn push(&mut self, clip: &WeightClip, names: &[&str], grid: PoseGrid) -> Result<()> {
        let refuse = |what: String, remedy: &str| Error::invalid(format!("clip '{}': {what}", clip.name), remedy);
        let bound = clip.bind(names)?;
        let frames = bound.frame_count();
        let fits = (1..=i32::MAX as usize).contains(&frames);
        ensure!(fits, refuse(format!("{frames} frames"), "give it 1 frame or more"));
        let is_rate = clip.fps > 0.0 && clip.fps.is_finite();
        ensure!(is_rate, refuse(format!("{} frames a second", clip.fps), "use a rate above 0"));
        let mut keys = reserved(frames * names.len(), || format!("the keys of clip '{}'", clip.name))?;
        for (frame, row) in bound.frames().enumerate() {
            for (name, &weight) in names.iter().zip(&row) {
                let key = grid.steps(weight);
                if weight.abs() > grid.weight_max || !(-KEY_MAX..=KEY_MAX).contains(&key) {
                    let most = grid.weight_max.min(KEY_MAX as f32 * grid.weight_step());
                    let what = format!("frame {frame}, target '{name}': the weight is {weight}");
                    return Err(refuse(what, &out_of_grid(most)));
                }
                keys.push(key);
            }
        }
        let first = self.words.len() as u32;
        let (shift, bits, lost) = match self.format {
            KeyFormat::Bits32 => {
                self.words.extend(keys.iter().map(|&key| key as u32));
                (0, 32, 0)
            }
            KeyFormat::Bits16 => {
                let most = grid.steps(grid.weight_max);
                let fits = |shift: &u32| keys.iter().all(|&key| i16::try_from(shortened(key, *shift, most)).is_ok());
                // 15 always suffices: keys have 31 bits and a sign.
                let shift = (0..16).find(fits).unwrap_or(16);
                let half = |key: &i32| shortened(*key, shift, most) as u32 & 0xffff;
                self.words.extend(keys.chunks(2).map(|pair| half(&pair[0]) | pair.get(1).map_or(0, half) << 16));
                let lost = keys.iter().map(|&key| key.abs_diff(shortened(key, shift, most) << shift)).max();
                (shift, 16, lost.unwrap_or(0))
            }
        };
        let entry = &mut self.words[TABLE_WORDS * self.clips.len()..][..TABLE_WORDS];
        entry.copy_from_slice(&[first, frames as u32, shift, bits]);
        self.clips.push(Clip { fps: clip.fps, rounding: lost as f32 * grid.weight_step() });
        Ok(())
    }

    /// First word of the ranks for levels of detail; `None` without an order of importance.
    pub(crate) fn ranks_at(&self) -> Option<u32> {
        (self.ranks_at > 0).then_some(self.ranks_at)
    }

    /// Table, keys, ranks, reaches and errors, as kernels read them.
    #[doc(hidden)]
    pub fn words(&self) -> &[u32] {
        &self.words
    }

    /// Number of clips.
    pub fn count(&self) -> usize {
        self.clips.len()
    }

    /// Number of targets: keys per frame.
    #[doc(hidden)]
    pub fn targets(&self) -> usize {
        self.targets
    }

    /// Number of frames of a clip; `None` if there is no such clip.
    pub fn frames(&self, clip: usize) -> Option<u32> {
        (clip < self.count()).then(|| self.frame_count(clip))
    }

    /// Number of frames of an existing clip.
    pub(crate) fn frame_count(&self, clip: usize) -> u32 {
        self.words[TABLE_WORDS * clip + 1]
    }

    /// Frames per second of a clip; `None` if there is no such clip.
    pub fn fps(&self, clip: usize) -> Option<f32> {
        self.clips.get(clip).map(|clip| clip.fps)
    }

    /// Largest change of a weight from 16-bit keys of a clip; 0 for 32-bit keys. The grid's own rounding, half a
    /// [`weight_step`](PoseGrid::weight_step), adds to it. `None` if there is no such clip.
    pub fn rounding(&self, clip: usize) -> Option<f32> {
        self.clips.get(clip).map(|clip| clip.rounding)
    }
}

/// `key` without its low `shift` bits, rounded to nearest, but within `most` when shifted back, since sums would
/// overflow.
fn shortened(key: i32, shift: u32, most: i32) -> i32 {
    let short = (key + ((1 << shift) >> 1)) >> shift;
    if (i64::from(short) << shift).abs() > i64::from(most) { short - short.signum() } else { short }
}
