//! Rigs: controls that an animator or a performance capture moves, and the targets that each of them drives.

#![forbid(unsafe_code)]

mod bound;
mod json;
pub mod names;
#[cfg(test)]
mod tests;
#[cfg(feature = "gltf")]
pub mod vrm;

pub use bound::BoundRig;
pub use json::read;

use deltamorph::internals::weights::names::unknown;
use deltamorph::{Error, Result, setters};
use std::collections::{HashMap, HashSet};

/// Controls that drive the targets of a mesh, and targets that are driven by combinations of controls.
///
/// Without a rig, a clip or slider sets the weight of a target directly, and a vertex moves along a straight line: an
/// eyelid passes through the eyeball rather than round it. A rig gives a control several targets, its [keys](Key),
/// between which the pose is interpolated, and adds [correctives](Corrective) where two controls at once look wrong.
///
/// [`bind`](Self::bind) the rig to the targets of a mesh, and clips to the resulting [controls](BoundRig::controls).
/// [`BoundRig::evaluate`] then turns control weights into target weights, frame by frame; [`BoundRig::bake`] turns a
/// whole clip into target weights, for [animated crowds](deltamorph::AnimatedCrowd), which the GPU animates. [`read`] reads rigs
/// from JSON files.
///
/// ```
/// use deltamorph_rig::{Control, Corrective, Key, Rig};
///
/// // Half closed, the lid lies on the eyeball: a separate target.
/// let blink = Control::new("blink").keys(vec![Key::new(0.5, "blinkHalf"), Key::new(1.0, "blinkFull")]);
/// let squint = Corrective::new("squint", &["blink", "smile"]);
/// let rig = Rig { controls: vec![blink], correctives: vec![squint], ..Rig::default() };
/// let rig = rig.bind(&["smile", "blinkHalf", "blinkFull", "squint"])?;
/// // Targets that the rig does not name become controls.
/// assert_eq!(rig.controls().collect::<Vec<_>>(), ["blink", "smile"]);
///
/// let mut weights = [0.0; 4];
/// rig.evaluate(&[0.75, 0.5], &mut weights)?;
/// assert_eq!(weights, [0.5, 0.5, 0.5, 0.375]); // half way from one key to the next; 0.75 · 0.5
/// # Ok::<(), deltamorph::Error>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rig {
    /// The controls, in the order of the weights that [`BoundRig::evaluate`] takes.
    pub controls: Vec<Control>,
    /// Targets that several controls drive together.
    pub correctives: Vec<Corrective>,
    /// Targets that controls drive are controls as well, unless a control has their name, and weights add up. `false` by
    /// default.
    pub keep_targets: bool,
}

/// A control and the targets that it drives.
///
/// A value c lies between the neutral, at 0, and the keys on the same side of it, ordered by their distance from 0:
///
/// ```text
/// up to the first key      its weight is c / at
/// between two keys         1 − t of the nearer one, t of the farther one; t goes from 0 to 1 between them
/// beyond the last key      its weight is c / at: the last shape, exaggerated
/// ```
///
/// On a side without keys, the first key of the other side is continued through 0: its weight is c / at, below 0. So
/// the value of a control with one key at 1 is its target's weight. The weight is continuous from one rule to the next.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Control {
    /// Name of the control, as clips state it.
    pub name: String,
    /// Least and greatest value; values beyond them are clamped. From `-inf` to `inf` by default.
    pub limits: [f32; 2],
    /// Seconds in which [`BoundRig::smooth`] covers 63% (1 − 1/e) of the way to a new value. At 0, the default, the new
    /// value is taken at once.
    pub smoothing: f32,
    /// Targets driven by the control, in any order. Without keys and parts, the control drives the target of the same
    /// name, with limits and smoothing.
    pub keys: Vec<Key>,
    /// Targets that follow the control in proportion, beside those of the keys.
    pub parts: Vec<Part>,
    /// Values above 0.5 count as 1, all others as 0. `false` by default.
    pub is_binary: bool,
    /// Controls that count as 0 while this one is above 0.
    pub blocks: Vec<String>,
    /// Controls that are multiplied by 1 − c, at least 0, where c is the sum of the controls that attenuate them. One
    /// that [is binary](field@Self::is_binary) counts as 0 while c is above 0.
    pub attenuates: Vec<String>,
}

setters!(Control {
    limits: [f32; 2],
    smoothing: f32,
    keys: Vec<Key>,
    parts: Vec<Part>,
    is_binary: bool,
    blocks: Vec<String>,
    attenuates: Vec<String>,
});

impl Control {
    /// Makes a control without keys, limits and smoothing.
    pub fn new(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            limits: [f32::NEG_INFINITY, f32::INFINITY],
            smoothing: 0.0,
            keys: vec![],
            parts: vec![],
            is_binary: false,
            blocks: vec![],
            attenuates: vec![],
        }
    }

    /// Sets key-frame meshes as targets at equal steps: the control goes from the neutral, at 0, through all of them,
    /// to the last one, at 1. More key frames follow a movement on an arc more closely.
    #[must_use]
    pub fn sequence(self, targets: &[&str]) -> Self {
        let at = |i: usize| (i + 1) as f32 / targets.len() as f32;
        self.keys(targets.iter().enumerate().map(|(i, target)| Key::new(at(i), *target)).collect())
    }
}

/// A target at a value of a control: an in-between shape, or the final one.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Key {
    /// The control's value at which the target's weight is 1, and that of the control's other targets 0. It is not 0:
    /// that is the neutral.
    pub at: f32,
    /// The target's name.
    pub target: String,
}

impl Key {
    /// Makes a key: a target at a value of a control.
    pub fn new(at: f32, target: impl Into<String>) -> Self {
        Self { at, target: target.into() }
    }
}

/// A target that follows a control in proportion.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Part {
    /// The target's name.
    pub target: String,
    /// Its weight at the control's value 1.
    pub weight: f32,
}

impl Part {
    /// Makes a part: a target with its weight at the control's value 1.
    pub fn new(target: impl Into<String>, weight: f32) -> Self {
        Self { target: target.into(), weight }
    }
}

/// A target whose weight is the product of controls, each clamped to its limits and to at least 0. It corrects a
/// combination of shapes, and has no effect if one of the controls is at rest.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Corrective {
    /// The target's name.
    pub target: String,
    /// Names of the controls. A target that the rig drives in no other way counts as a control.
    pub controls: Vec<String>,
}

impl Corrective {
    /// Makes a corrective: a target that these controls drive together.
    pub fn new(target: impl Into<String>, controls: &[&str]) -> Self {
        Self { target: target.into(), controls: controls.iter().map(|&name| name.to_owned()).collect() }
    }
}

impl Rig {
    /// Binds the rig to a mesh with the targets `targets`. The bound rig has the rig's
    /// [`controls`](field@Self::controls), followed by each target that no key, part and corrective names (with
    /// [`keep_targets`](field@Self::keep_targets), that no control is called after), in the mesh's order.
    ///
    /// # Errors
    /// [`Error::Invalid`] for: a key or corrective that names no target or control; a control without keys whose name
    /// is no target; two controls of one name; two keys of a control at one value, or one at 0; values that are not
    /// finite; a least limit above the greatest; a smoothing below 0; a corrective without controls, or with one
    /// control twice; a control that blocks or attenuates one that there is not.
    pub fn bind(&self, targets: &[&str]) -> Result<BoundRig> {
        // Reversed, so that the first of several targets of one name is found, as in clips.
        let indices: HashMap<&str, usize> = targets.iter().enumerate().rev().map(|(i, target)| (*target, i)).collect();
        let target = |of: &str, name: &str| {
            let what = || format!("{of}: '{name}' is no target");
            indices.get(name).copied().ok_or_else(|| unknown(what(), name, "target of the mesh", targets))
        };
        let mut bound = BoundRig::new(targets);
        for control in &self.controls {
            let of = format!("control '{}' of the rig", control.name);
            control.check(&of)?;
            let alone = [Key::new(1.0, control.name.as_str())];
            let is_alone = control.keys.is_empty() && control.parts.is_empty();
            let keys = if is_alone { &alone[..] } else { &control.keys };
            let keys = keys.iter().map(|key| Ok((key.at, target(&of, &key.target)?))).collect::<Result<Vec<_>>>()?;
            let parts = control.parts.iter().map(|part| Ok((target(&of, &part.target)?, part.weight)));
            bound.add_control(control, keys, parts.collect::<Result<Vec<_>>>()?);
        }
        let corrected = |corrective: &Corrective| {
            target(&format!("corrective '{}' of the rig", corrective.target), &corrective.target)
        };
        let corrected = self.correctives.iter().map(corrected).collect::<Result<Vec<_>>>()?;
        let mut driven: HashSet<usize> = bound.driven().chain(corrected.iter().copied()).collect();
        if self.keep_targets {
            let named = self.controls.iter().filter_map(|control| indices.get(control.name.as_str()).copied());
            driven = named.collect();
        }
        for (index, name) in targets.iter().enumerate() {
            // A second target of the same name cannot be driven: a name finds the first one.
            if indices[name] == index && driven.insert(index) {
                bound.add_control(&Control::new(*name), vec![(1.0, index)], vec![]);
            }
        }
        let names: Vec<String> = bound.controls().map(str::to_owned).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let places: HashMap<&str, usize> = names.iter().enumerate().map(|(i, name)| (*name, i)).collect();
        if let Some((i, name)) = names.iter().enumerate().find(|(i, name)| places[*name] != *i) {
            let remedy = "rename or remove one of them; a control with the name of a target has to drive that target";
            return Err(Error::invalid(
                format!("controls {i} and {} of the rig are both called '{name}'", places[name]),
                remedy,
            ));
        }
        let factors = self.correctives.iter().map(|corrective| corrective.factors(&places, &names));
        let factors = factors.collect::<Result<Vec<_>>>()?;
        let mut suppressed = vec![];
        for (by, control) in self.controls.iter().enumerate() {
            let of =
                |names: &[String], blocks: bool| names.iter().map(|name| (name.clone(), blocks)).collect::<Vec<_>>();
            for (name, blocks) in [of(&control.blocks, true), of(&control.attenuates, false)].concat() {
                let what = || format!("control '{}' of the rig: '{name}' is no control", control.name);
                let no_control = || unknown(what(), &name, "control of the rig", &names);
                suppressed.push((*places.get(name.as_str()).ok_or_else(no_control)?, by, blocks));
            }
        }
        bound.add_suppressed(suppressed);
        bound.add_correctives(corrected.into_iter().zip(factors));
        Ok(bound)
    }
}

impl Control {
    fn check(&self, of: &str) -> Result<()> {
        let refuse = |what: String, remedy: &str| Err(Error::invalid(format!("{of}: {what}"), remedy));
        let [least, greatest] = self.limits;
        let ordered = least <= greatest;
        if !ordered || least == f32::INFINITY || greatest == f32::NEG_INFINITY {
            return refuse(format!("limits from {least} to {greatest}"), "give the least value first");
        }
        if !(self.smoothing.is_finite() && self.smoothing >= 0.0) {
            return refuse(format!("a smoothing of {} seconds", self.smoothing), "use a finite number, 0 or more");
        }
        if let Some(part) = self.parts.iter().find(|part| !part.weight.is_finite()) {
            let what = format!("target '{}' with the weight {}", part.target, part.weight);
            return refuse(what, "use a finite number");
        }
        let mut taken = HashMap::new();
        for key in &self.keys {
            let (at, target) = (key.at, &key.target);
            if !at.is_normal() {
                let remedy = "use a finite number other than 0: 0 is the neutral";
                return refuse(format!("target '{target}' at {at}"), remedy);
            }
            // Neither 0 nor NaN: equal numbers have equal bits.
            if let Some(other) = taken.insert(at.to_bits(), target) {
                let remedy = "give each key another value";
                return refuse(format!("targets '{other}' and '{target}' are both at {at}"), remedy);
            }
        }
        Ok(())
    }
}

impl Corrective {
    /// Returns the indices of the controls that are multiplied.
    fn factors(&self, places: &HashMap<&str, usize>, names: &[&str]) -> Result<Vec<usize>> {
        let of = format!("corrective '{}' of the rig", self.target);
        if self.controls.is_empty() {
            return Err(Error::invalid(format!("{of}: no control drives it"), "name the controls that are multiplied"));
        }
        let (mut factors, mut seen) = (Vec::with_capacity(self.controls.len()), HashSet::new());
        for name in &self.controls {
            let what = || format!("{of}: '{name}' is no control");
            let factor =
                *places.get(name.as_str()).ok_or_else(|| unknown(what(), name, "control of the rig", names))?;
            if !seen.insert(factor) {
                return Err(Error::invalid(format!("{of}: control '{name}' is named twice"), "name it once"));
            }
            factors.push(factor);
        }
        Ok(factors)
    }
}
