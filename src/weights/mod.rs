//! Weight clips, by target name and bound to a mesh; delta weights.

pub mod delta;
pub mod names;
mod normalised;

use crate::error::{Error, Result, ensure, listed, reserved, shortened};
use crate::names::composed;
use names::{closest, meanings};
pub use normalised::normalise_weights;
use std::collections::HashSet;

/// Most pairs of an unknown column and a target whose names are compared for a message.
const NEAR_PAIRS: usize = 1 << 16;
/// Most such columns.
const NEAR_COLUMNS: usize = 64;

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
    /// What reading it left out or assumed, for a person to see.
    pub notes: Vec<String>,
}

impl WeightClip {
    /// Number of frames.
    pub fn frame_count(&self) -> usize {
        self.values.len().checked_div(self.names.len()).unwrap_or(0)
    }

    /// Binds the clip to a mesh with these `targets`, in their order, by what the names of its columns mean. Targets
    /// without a column get 0, and [`BoundClip::notes`] says which columns mean no target: these move nothing.
    ///
    /// A column that names a target moves that one. Any other means the targets of the same name but for Unicode form,
    /// case and separators, the side (`_L` or `.L` for `Left`), and what stands before it: a node, as in
    /// `face.jawOpen`, and Maya's `ai_`. A column without a side means the targets of both sides, if none has its own
    /// name. Each target takes the first column that means it.
    ///
    /// Takes memory proportional to the clip's values, for any number of targets.
    ///
    /// ```
    /// use deltamorph::WeightClip;
    ///
    /// let names = ["face.ai_browDown_L", "mouth-smile", "frame"].map(String::from).to_vec();
    /// let clip = WeightClip { names, fps: 30.0, values: vec![0.25, 0.5, 1.0], ..WeightClip::default() };
    /// let bound = clip.bind(&["browDownLeft", "mouthSmile_L", "mouthSmile_R"])?;
    /// assert_eq!(bound.frame(0)?, [0.25, 0.5, 0.5]);
    /// assert_eq!(bound.notes[0], "2 of 3 columns move targets; left out, as no target is called so: 'frame'");
    /// # Ok::<(), deltamorph::Error>(())
    /// ```
    ///
    /// # Errors
    /// No column means a target; two have the name of one; a weight of a column that moves a target is not finite; a
    /// number of values that is not a multiple of the number of columns; [`Error::OutOfMemory`].
    pub fn bind(&self, targets: &[&str]) -> Result<BoundClip> {
        self.bind_holding(targets, &[])
    }

    /// Like [`bind`](Self::bind), with other weights of the targets `held`, the same in every frame: in one frame, if
    /// there are no columns.
    #[doc(hidden)]
    pub fn bind_holding(&self, targets: &[&str], held: &[(usize, f32)]) -> Result<BoundClip> {
        let meant = meanings(&self.names, targets).map_err(|name| self.twice(name))?;
        ensure!(meant.is_empty() || meant.iter().any(Option::is_some), self.unknown(targets));
        let set: HashSet<usize> = held.iter().map(|(target, _)| *target).collect();
        // The columns that move targets, and their places among those.
        let mut used = vec![];
        let mut columns = vec![];
        let [mut lost, mut second, mut several] = [const { vec![] }; 3];
        for (column, (name, meant)) in self.names.iter().zip(meant).enumerate() {
            match meant.as_deref() {
                None => lost.push(name.as_str()),
                Some([]) => second.push(name),
                Some([_]) => {}
                Some(_) => several.push(name),
            }
            let free = meant.into_iter().flatten().filter(|target| !set.contains(target));
            let before = columns.len();
            columns.extend(free.map(|target| (target, used.len())));
            if columns.len() > before {
                used.push(column);
            }
        }
        self.check_weights(&used)?;
        let (name, mut notes, width) = (self.name.clone(), self.notes.clone(), used.len() + held.len());
        let moving = format!(
            "{} of {} columns move targets; left out, as no target is called so",
            self.names.len() - lost.len(),
            self.names.len()
        );
        for (what, names) in [
            (moving.as_str(), lost),
            ("left out, as other columns move their targets", second),
            ("columns that move several targets at once", several),
        ] {
            if !names.is_empty() {
                notes.push(format!("{what}: {}", listed(&names)));
            }
        }
        let rows = if self.names.is_empty() { 1 } else { self.frame_count() };
        let mut values = reserved(rows.saturating_mul(width), || format!("the weights of clip '{name}'"))?;
        for row in 0..rows {
            values.extend(used.iter().map(|column| self.values[row * self.names.len() + column]));
            values.extend(held.iter().map(|(_, weight)| weight));
        }
        columns.extend(held.iter().zip(used.len()..).map(|((target, _), column)| (*target, column)));
        Ok(BoundClip { name, fps: self.fps, notes, targets: targets.len(), columns, width, values })
    }

    /// The error for a clip of which no column means a target.
    fn unknown(&self, targets: &[&str]) -> Error {
        let looked_for = (1 + NEAR_PAIRS / (1 + targets.len())).min(NEAR_COLUMNS);
        let names: Vec<&str> = self.names.iter().map(String::as_str).collect();
        let near = names.iter().take(looked_for).filter_map(|name| Some((name, closest(name, targets)?)));
        let near: Vec<String> = near.take(3).map(|(name, near)| format!("'{}' to '{near}'", shortened(name))).collect();
        let remedy = match &near[..] {
            [] if targets.is_empty() => "give a mesh that has targets",
            [] => "rename columns to targets",
            near => &format!("rename {} if that is meant", near.join(", ")),
        };
        let what = format!("none of its columns ({}) is a target of the mesh ({})", listed(&names), listed(targets));
        self.error(what, remedy)
    }

    /// Distinct names, whole rows, finite values.
    #[doc(hidden)]
    pub fn check(&self) -> Result<()> {
        let mut seen = HashSet::with_capacity(self.names.len());
        for name in &self.names {
            ensure!(seen.insert(composed(name)), self.twice(name));
        }
        self.check_weights(&(0..self.names.len()).collect::<Vec<_>>())
    }

    fn twice(&self, name: &str) -> Error {
        self.error(format!("two columns are called '{}'", shortened(name)), "rename or remove one of them")
    }

    fn error(&self, what: String, remedy: &str) -> Error {
        Error::invalid(format!("clip '{}': {what}", self.name), remedy)
    }

    /// Whole rows, and finite weights in the columns `used`.
    fn check_weights(&self, used: &[usize]) -> Result<()> {
        let (count, columns) = (self.values.len(), self.names.len());
        let what = || format!("{count} values in {columns} columns are no whole number of frames");
        let is_whole = count == self.frame_count() * columns;
        ensure!(is_whole, self.error(what(), "give one value per column and frame"));
        for (frame, row) in self.values.chunks(columns.max(1)).enumerate() {
            for &column in used {
                let weight = row[column];
                let what =
                    || format!("column '{}', frame {frame}: the weight is {weight}", shortened(&self.names[column]));
                ensure!(weight.is_finite(), self.error(what(), "replace it with a finite number"));
            }
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
    /// What reading and binding it left out or assumed, for a person to see.
    pub notes: Vec<String>,
    targets: usize,
    /// Each target that the clip animates, and its column.
    columns: Vec<(usize, usize)>,
    /// Number of columns.
    width: usize,
    values: Vec<f32>,
}

impl BoundClip {
    /// Number of frames.
    pub fn frame_count(&self) -> usize {
        self.values.len().checked_div(self.width).unwrap_or(0)
    }

    /// Number of targets that the clip animates.
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
        let row = &self.values[frame * self.width..];
        self.columns.iter().for_each(|&(target, column)| weights[target] = row[column]);
        weights
    }

    /// Makes weights of absolute poses weights of deltas, by [`normalise_weights`], frame by frame.
    #[doc(hidden)]
    pub fn normalise(&mut self) {
        for row in self.values.chunks_mut(self.width.max(1)) {
            let mut weights: Vec<f32> = self.columns.iter().map(|(_, column)| row[*column]).collect();
            normalise_weights(&mut weights);
            self.columns.iter().zip(weights).for_each(|((_, column), weight)| row[*column] = weight);
        }
    }

    /// The largest absolute weight.
    #[doc(hidden)]
    pub fn largest(&self) -> f32 {
        self.values.iter().fold(0.0, |most, weight| most.max(weight.abs()))
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
        WeightClip { name: "clip".into(), names, fps: 30.0, values: values.to_vec(), notes: vec![] }
    }

    #[test]
    fn columns_are_put_at_their_targets_and_the_rest_is_zero() {
        let bound = clip(&["b", "a"], &[1.0, 2.0, -3.0, 4.5]).bind(&["a", "x", "b"]).unwrap();
        assert_eq!(bound.frames().collect::<Vec<_>>(), [[2.0, 0.0, 1.0], [4.5, 0.0, -3.0]]);
        assert!(bound.frame(2).unwrap_err().to_string().contains("frame 2 of clip 'clip', which has 2"));
        assert_eq!((bound.name.as_str(), bound.fps, bound.target_count()), ("clip", 30.0, 3));
        assert_eq!(clip(&["b", "a"], &[]).bind(&["a", "b"]).unwrap().frame_count(), 0);
        assert_eq!(WeightClip::default().bind(&[]).unwrap().frame_count(), 0);
        crate::testing::says(clip(&["a", "b"], &[1.0]).bind(&["a"]), &["clip 'clip': ", "1 values in 2 columns"]);
    }
}
