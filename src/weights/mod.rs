//! Weights: clips, applied weights, delta weights.

pub mod delta;

#[cfg(feature = "csv")]
pub use crate::import::csv;

use crate::error::{Error, Result};
use std::collections::{HashMap, HashSet};

/// A weight clip: one row of weights per frame, columns by target name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WeightClip {
    /// Name for messages and reports (the file's stem).
    pub name: String,
    /// Column names.
    pub names: Vec<String>,
    /// Frames per second.
    pub fps: f32,
    /// `names.len()` weights per frame, frame after frame.
    pub values: Vec<f32>,
}

impl WeightClip {
    /// Number of frames.
    pub fn frame_count(&self) -> usize {
        self.values.len().checked_div(self.names.len()).unwrap_or(0)
    }

    /// One weight per target for each frame, in the order of `targets`; targets without a column get 0.
    ///
    /// # Errors
    /// A column that names no target, two columns of one name, a weight that is not finite, or a number of values
    /// that is not a multiple of the number of columns.
    pub fn bind(&self, targets: &[&str]) -> Result<Vec<Vec<f32>>> {
        self.check()?;
        let mut places = HashMap::with_capacity(targets.len());
        for (i, &target) in targets.iter().enumerate() {
            places.entry(target).or_insert(i);
        }
        let mut unknown = self.names.iter().filter(|name| !places.contains_key(name.as_str()));
        if let Some(name) = unknown.next() {
            let more = match unknown.count() {
                0 => String::new(),
                n => format!(" (nor do {n} other columns)"),
            };
            let what = format!("clip '{}': column '{name}' names no target of the mesh{more}", self.name);
            let remedy = match closest(name, targets) {
                Some(target) => format!("rename the column to '{target}' if that is meant, or remove it"),
                None if targets.is_empty() => "the mesh has no targets: give one that has".to_owned(),
                None => "rename the column to a target of the mesh, or remove it".to_owned(),
            };
            return Err(Error::invalid(what, remedy));
        }
        // `check` has made the names distinct, so no two columns write one place.
        let places: Vec<usize> = self.names.iter().map(|name| places[name.as_str()]).collect();
        let row = |values: &[f32]| {
            let mut row = vec![0.0; targets.len()];
            for (&place, &value) in places.iter().zip(values) {
                row[place] = value;
            }
            row
        };
        Ok(self.values.chunks_exact(self.names.len().max(1)).map(row).collect())
    }

    /// Distinct names, whole rows, finite values.
    pub(crate) fn check(&self) -> Result<()> {
        let refuse = |what: String, remedy: &str| Err(Error::invalid(format!("clip '{}': {what}", self.name), remedy));
        let columns = self.names.len();
        let mut seen = HashSet::with_capacity(columns);
        if let Some(name) = self.names.iter().find(|name| !seen.insert(name.as_str())) {
            return refuse(format!("two columns are called '{name}'"), "rename or remove one of them");
        }
        if self.values.len() != self.frame_count() * columns {
            let what = format!("{} values in {columns} columns are no whole number of frames", self.values.len());
            return refuse(what, "give one value per column and frame");
        }
        if let Some(i) = self.values.iter().position(|w| !w.is_finite()) {
            let what = format!(
                "column '{}', frame {}: the weight is {}",
                self.names[i % columns],
                i / columns,
                self.values[i]
            );
            return refuse(what, "replace it with a finite number");
        }
        Ok(())
    }
}

/// The target that `name` was probably meant to be: the nearest by edit distance, when it is near at all.
fn closest<'a>(name: &str, targets: &[&'a str]) -> Option<&'a str> {
    // Case and separators are where naming schemes differ.
    let plain = |s: &str| s.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect::<Vec<_>>();
    let wanted = plain(name);
    let (distance, target) = targets.iter().map(|t| (distance(&wanted, &plain(t)), *t)).min_by_key(|(d, _)| *d)?;
    (distance <= (wanted.len() / 3).max(2) && distance < wanted.len().max(1)).then_some(target)
}

/// Levenshtein distance.
fn distance(a: &[char], b: &[char]) -> usize {
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.iter().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let substituted = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = substituted.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clip(names: &[&str], values: &[f32]) -> WeightClip {
        let names = names.iter().map(|&n| n.to_owned()).collect();
        WeightClip { name: "clip".into(), names, fps: 30.0, values: values.to_vec() }
    }

    #[test]
    fn columns_go_to_their_targets_and_the_rest_is_zero() {
        let rows = clip(&["b", "a"], &[1.0, 2.0, -3.0, 4.5]).bind(&["a", "x", "b"]).unwrap();
        assert_eq!(rows, [[2.0, 0.0, 1.0], [4.5, 0.0, -3.0]]);
        assert!(clip(&["b", "a"], &[]).bind(&["a", "b"]).unwrap().is_empty());
        assert!(WeightClip::default().bind(&[]).unwrap().is_empty());
    }

    #[test]
    fn an_unknown_column_is_named_with_the_target_that_is_near() {
        let message = |name| clip(&[name], &[0.0]).bind(&["jawOpen", "eyeBlink_L"]).unwrap_err().to_string();
        assert!(message("eyeBlinkLeft").contains("column 'eyeBlinkLeft'"), "{}", message("eyeBlinkLeft"));
        assert!(message("eyeBlinkLeft").contains("'eyeBlink_L'"), "{}", message("eyeBlinkLeft"));
        assert!(message("jaw_open").contains("'jawOpen'"));
        assert!(!message("tongueOut").contains("jawOpen"));
        assert!(message("tongueOut").contains("or remove it"));
    }

    #[test]
    fn what_cannot_be_bound_is_refused() {
        let message = |names: &[&str], values: &[f32]| clip(names, values).bind(&["a", "b"]).unwrap_err().to_string();
        assert!(message(&["a", "a"], &[]).contains("two columns are called 'a'"));
        assert!(message(&["a", "b"], &[1.0]).contains("1 values in 2 columns"));
        assert!(message(&["a", "b"], &[1.0, f32::NAN]).contains("column 'b', frame 0"));
    }
}
