//! Weight clips, by target name and bound to a mesh; delta weights.

pub mod delta;
pub mod names;
mod normalised;

use crate::error::{Error, Result, ensure, refuse};
use names::closest;
pub use normalised::normalise_weights;
use std::collections::{HashMap, HashSet};
use unicode_normalization::UnicodeNormalization;

/// Most unknown columns for which similar target names are searched.
const NEAR_LOOKED_FOR: usize = 64;

/// A weight clip: one row of weights per frame, one column per target name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WeightClip {
    /// Name in messages and reports (the file's stem).
    pub name: String,
    /// Column names.
    pub names: Vec<String>,
    /// Frames per second.
    pub fps: f32,
    /// `names.len()` weights per frame, frame by frame.
    pub values: Vec<f32>,
}

impl WeightClip {
    /// Number of frames.
    pub fn frame_count(&self) -> usize {
        self.values.len().checked_div(self.names.len()).unwrap_or(0)
    }

    /// Binds the clip to a mesh with these `targets`, in their order; targets without a column get 0. Names are
    /// compared in Unicode's composed form (NFC).
    ///
    /// Takes memory proportional to the clip's values, for any number of targets.
    ///
    /// # Errors
    /// A column that names no target; two columns of one name; a weight that is not finite; a number of values that is
    /// not a multiple of the number of columns.
    pub fn bind(&self, targets: &[&str]) -> Result<BoundClip> {
        // Reversed, so that the first of several targets of one name is kept.
        let named = targets.iter().enumerate().rev();
        let indices: HashMap<String, usize> = named.map(|(i, target)| (target.nfc().collect(), i)).collect();
        let mut columns = vec![];
        let mut unknown = vec![];
        for name in &self.names {
            match indices.get(&name.nfc().collect::<String>()) {
                Some(target) => columns.push(*target),
                None => unknown.push(name.as_str()),
            }
        }
        if let [name, rest @ ..] = &unknown[..] {
            let more = match rest.len() {
                0 => String::new(),
                n if n + 1 == self.names.len() => format!(" (nor does any of the other {n})"),
                n => format!(" (nor do {n} other columns)"),
            };
            let near = unknown.iter().take(NEAR_LOOKED_FOR).filter_map(|name| Some((name, closest(name, targets)?)));
            let near: Vec<String> = near.take(3).map(|(name, target)| format!("'{name}' to '{target}'")).collect();
            let remedy = match &near[..] {
                [] if targets.is_empty() => "the mesh has no targets: give one that has".to_owned(),
                [] => "rename columns to targets of the mesh, or remove them".to_owned(),
                near => format!("rename {} if that is meant, or remove columns", near.join(", ")),
            };
            let what = format!("clip '{}': column '{name}' names no target of the mesh{more}", self.name);
            return refuse(what, remedy);
        }
        // Distinct names, so that each column has its own target.
        self.check()?;
        let values = self.values.clone();
        Ok(BoundClip { name: self.name.clone(), fps: self.fps, targets: targets.len(), columns, values })
    }

    /// Distinct names, whole rows, finite values.
    #[doc(hidden)]
    pub fn check(&self) -> Result<()> {
        let refuse = |what: String, remedy: &str| Error::invalid(format!("clip '{}': {what}", self.name), remedy);
        let columns = self.names.len();
        let mut seen = HashSet::with_capacity(columns);
        for name in &self.names {
            let is_new = seen.insert(name.nfc().collect::<String>());
            ensure!(is_new, refuse(format!("two columns are called '{name}'"), "rename or remove one of them"));
        }
        let count = self.values.len();
        let what = format!("{count} values in {columns} columns are no whole number of frames");
        ensure!(count == self.frame_count() * columns, refuse(what, "give one value per column and frame"));
        for (i, weight) in self.values.iter().enumerate() {
            let (name, frame) = (&self.names[i % columns], i / columns);
            let what = || format!("column '{name}', frame {frame}: the weight is {weight}");
            ensure!(weight.is_finite(), refuse(what(), "replace it with a finite number"));
        }
        Ok(())
    }
}

/// Behaviour of a clip outside its frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Repeat {
    /// Loops; the last frame is followed by the first.
    #[default]
    Loop,
    /// Holds the first frame before the clip and the last one after it.
    Once,
}

/// A weight clip bound to the targets of a mesh by [`WeightClip::bind`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BoundClip {
    /// Name of the clip.
    pub name: String,
    /// Frames per second.
    pub fps: f32,
    targets: usize,
    /// The target of each column.
    columns: Vec<usize>,
    values: Vec<f32>,
}

impl BoundClip {
    /// Number of frames.
    pub fn frame_count(&self) -> usize {
        self.values.len().checked_div(self.columns.len()).unwrap_or(0)
    }

    /// Number of columns: targets that the clip animates.
    pub fn column_count(&self) -> usize {
        self.columns.len()
    }

    /// Number of targets: weights per frame.
    pub fn target_count(&self) -> usize {
        self.targets
    }

    /// The weights of a frame, one per target.
    ///
    /// # Errors
    /// A frame out of range.
    pub fn frame(&self, frame: usize) -> Result<Vec<f32>> {
        let count = self.frame_count();
        let what = || format!("frame {frame} of clip '{}', which has {count}", self.name);
        ensure!(frame < count, what(), "count frames from 0");
        Ok(self.weights(frame))
    }

    fn weights(&self, frame: usize) -> Vec<f32> {
        let mut weights = vec![0.0; self.targets];
        let row = &self.values[frame * self.columns.len()..];
        self.columns.iter().zip(row).for_each(|(&target, &weight)| weights[target] = weight);
        weights
    }

    /// The weights of every frame, in order.
    pub fn frames(&self) -> impl ExactSizeIterator<Item = Vec<f32>> {
        (0..self.frame_count()).map(|frame| self.weights(frame))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clip(names: &[&str], values: &[f32]) -> WeightClip {
        let names = names.iter().map(|&n| n.to_owned()).collect();
        WeightClip { name: "clip".into(), names, fps: 30.0, values: values.to_vec() }
    }

    #[test]
    fn columns_are_put_at_their_targets_and_the_rest_is_zero() {
        let bound = clip(&["b", "a"], &[1.0, 2.0, -3.0, 4.5]).bind(&["a", "x", "b"]).unwrap();
        assert_eq!(bound.frames().collect::<Vec<_>>(), [[2.0, 0.0, 1.0], [4.5, 0.0, -3.0]]);
        assert!(bound.frame(2).unwrap_err().to_string().contains("frame 2 of clip 'clip', which has 2"));
        assert_eq!((bound.name.as_str(), bound.fps, bound.target_count()), ("clip", 30.0, 3));
        assert_eq!(clip(&["b", "a"], &[]).bind(&["a", "b"]).unwrap().frame_count(), 0);
        assert_eq!(WeightClip::default().bind(&[]).unwrap().frame_count(), 0);
    }

    #[test]
    fn what_cannot_be_bound_is_named_with_the_target_that_is_near() {
        let cases: [(&[&str], &[f32], [&str; 2]); 5] = [
            (&["eye_blink_l"], &[0.0], ["'eye_blink_l' names no target", "rename 'eye_blink_l' to 'eyeBlink_L' if"]),
            (&["tongueOut"], &[0.0], ["column 'tongueOut'", "rename columns to targets of the mesh, or remove them"]),
            (&["jawOpen", "jawOpen"], &[], ["clip 'clip': ", "two columns are called 'jawOpen'"]),
            (&["jawOpen", "eyeBlink_L"], &[1.0], ["clip 'clip': ", "1 values in 2 columns"]),
            (&["jawOpen", "eyeBlink_L"], &[1.0, f32::NAN], ["column 'eyeBlink_L', frame 0", "the weight is NaN"]),
        ];
        for (names, values, parts) in cases {
            let message = clip(names, values).bind(&["jawOpen", "eyeBlink_L"]).unwrap_err().to_string();
            assert!(parts.iter().all(|part| message.contains(part)), "{message}");
        }
    }
}
