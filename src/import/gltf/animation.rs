//! Animations: keys of weights and of nodes, and their values at a time, in double precision.

use super::container::Container;
use super::json::At;
use crate::error::{Result, ensure};
use crate::import::{DEFAULT_FPS, frame_rate};
use glam::DQuat;

/// An animation: channels that play together.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct Animation {
    /// Its name, unique in the file: an animation without a name gets a number, and a repeated name is followed by one.
    pub name: String,
    /// Its channels. Channels without a node or keys, of a property other than the four of glTF 2.0, or that cannot be
    /// read, are left out. One that KHR_animation_pointer lets drive the weights
    /// of a mesh is there for each node that draws the mesh and states no weights of its own.
    #[doc(hidden)]
    pub channels: Vec<Channel>,
}

/// The property that a channel animates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[doc(hidden)]
pub enum Property {
    /// The node's translation: 3 numbers.
    Translation,
    /// The node's rotation: a quaternion x y z w.
    Rotation,
    /// The node's scale: 3 numbers.
    Scale,
    /// A weight for each target of the node's mesh, or for [`Channel::target`] alone.
    Weights,
}

/// The interpolation between two keys.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[doc(hidden)]
pub enum Interpolation {
    /// The value of the earlier key.
    Step,
    /// Linear; for rotations, along the shorter arc at constant speed.
    Linear,
    /// A cubic Hermite spline (glTF 2.0, appendix C.5). A key has three values: tangent in, value, tangent out.
    CubicSpline,
}

/// Keys of one property of one node.
#[derive(Clone, Debug)]
#[doc(hidden)]
pub struct Channel {
    /// Index of the node.
    pub node: usize,
    /// The property that it animates.
    pub property: Property,
    /// The only target whose weight it animates (KHR_animation_pointer); `None`: those of all targets.
    pub target: Option<usize>,
    /// The interpolation between keys.
    pub interpolation: Interpolation,
    /// The times of the keys in seconds, ascending; at least one.
    pub times: Vec<f32>,
    /// The numbers of each key: 3, or 4 of a rotation, or one for each target whose weight it animates; three times as
    /// many for [`Interpolation::CubicSpline`].
    pub values: Vec<f32>,
}

/// A time between two keys.
#[derive(Clone, Copy, Debug)]
pub(super) struct Between {
    /// Index of the earlier key.
    key: usize,
    /// Seconds between the keys.
    length: f64,
    /// Share of them that has passed, 0 to 1; `None`: the value is that of the key.
    part: Option<f64>,
}

impl Channel {
    /// Returns the numbers per value.
    pub(super) fn width(&self) -> usize {
        self.values.len() / self.times.len() / self.values_per_key()
    }

    fn values_per_key(&self) -> usize {
        if self.interpolation == Interpolation::CubicSpline { 3 } else { 1 }
    }

    /// Returns the times of the first and the last key, in seconds. Before and after, the value is that of the nearest
    /// key.
    pub fn span(&self) -> [f64; 2] {
        [self.times.first(), self.times.last()].map(|time| time.copied().unwrap_or(0.0).into())
    }

    /// Returns the values at `time`, in seconds. A rotation is not normalised.
    pub fn sample(&self, time: f64) -> Vec<f64> {
        let between = self.between(time);
        if let (Property::Rotation, Interpolation::Linear, Some(t)) = (self.property, self.interpolation, between.part)
        {
            let key = |key: usize| DQuat::from_array(std::array::from_fn(|i| self.value(key, 0, i)));
            let unit = |q: DQuat| if q.length_squared() > 0.0 { q.normalize() } else { DQuat::IDENTITY };
            return unit(key(between.key)).slerp(unit(key(between.key + 1)), t).to_array().to_vec();
        }
        (0..self.width()).map(|i| self.number(i, between)).collect()
    }

    /// Returns the position of `time`, in seconds, among the keys.
    pub(super) fn between(&self, time: f64) -> Between {
        let after = self.times.partition_point(|t| f64::from(*t) <= time);
        if after == 0 || after == self.times.len() || self.interpolation == Interpolation::Step {
            return Between { key: after.saturating_sub(1), length: 0.0, part: None };
        }
        let [start, end] = [after - 1, after].map(|key| f64::from(self.times[key]));
        Between { key: after - 1, length: end - start, part: Some((time - start) / (end - start)) }
    }

    /// Returns number `i` of the value at that position; not for a rotation between two keys.
    pub(super) fn number(&self, i: usize, Between { key, length, part }: Between) -> f64 {
        let own = self.values_per_key() / 2;
        let p0 = self.value(key, own, i);
        let Some(t) = part else { return p0 };
        let p1 = self.value(key + 1, own, i);
        if self.interpolation != Interpolation::CubicSpline {
            return p0 + (p1 - p0) * t;
        }
        let t2 = t * t;
        let t3 = t * t * t;
        let out = self.value(key, 2, i);
        let into = self.value(key + 1, 0, i);
        (2.0 * t3 - 3.0 * t2 + 1.0) * p0
            + length * (t3 - 2.0 * t2 + t) * out
            + (3.0 * t2 - 2.0 * t3) * p1
            + length * (t3 - t2) * into
    }

    /// Returns number `i` of a key's value: its only one (0); for splines the tangent in (0), the value (1) or the
    /// tangent out (2).
    fn value(&self, key: usize, which: usize, i: usize) -> f64 {
        self.values[(key * self.values_per_key() + which) * self.width() + i].into()
    }

    /// Returns `time`, or the time of a key within `distance` of it, so that steps happen in the frame they belong to.
    pub(super) fn near_key(&self, time: f64, distance: f64) -> f64 {
        let after = self.times.partition_point(|t| f64::from(*t) < time - distance);
        self.times.get(after).map(|t| f64::from(*t)).filter(|key| (key - time).abs() <= distance).unwrap_or(time)
    }
}

/// Times that differ by less than this part of a frame count as equal.
pub(super) const NEAR: f64 = 1e-3;

impl Animation {
    pub(super) fn weight_channels(&self) -> impl Iterator<Item = &Channel> {
        self.channels.iter().filter(|channel| channel.property == Property::Weights)
    }

    /// Whether it moves nodes, and no weights.
    #[doc(hidden)]
    pub fn moves_joints_alone(&self) -> bool {
        !self.channels.is_empty() && self.weight_channels().next().is_none()
    }

    /// The channels that frames follow: those of weights or, if it has none, all.
    fn timed(&self) -> impl Iterator<Item = &Channel> {
        let all = self.moves_joints_alone();
        self.channels.iter().filter(move |channel| all || channel.property == Property::Weights)
    }

    /// Returns the frames per second of evenly spaced keys (within 2% of a frame), 20 or more; otherwise 30. Keys of
    /// weights count or, if it moves joints alone, those of joints.
    pub(super) fn frame_rate(&self) -> f32 {
        let Some(longest) = self.timed().max_by_key(|channel| channel.times.len()) else { return DEFAULT_FPS };
        let [first, last] = longest.span();
        let fps = (longest.times.len() as f64 - 1.0) / (last - first);
        let even = |(i, t): (usize, &f32)| ((f64::from(*t) - first) * fps - i as f64).abs() < 0.02;
        if !(fps.is_finite() && fps > 0.0 && longest.times.iter().enumerate().all(even)) {
            return DEFAULT_FPS;
        }
        // Undo rounding to single precision: 29.999998 means 30.
        let fps = if (fps - fps.round()).abs() < 1e-3 * fps { fps.round() } else { fps };
        // Keys that are further apart are no frames.
        if fps < 20.0 { DEFAULT_FPS } else { fps as f32 }
    }

    /// The times of frames from the first to the last key that counts, of `width` values each.
    pub(super) fn frames(&self, fps: f32, width: usize) -> Result<impl ExactSizeIterator<Item = f64> + use<>> {
        let fps = f64::from(frame_rate(fps)?);
        let spans = self.timed().map(Channel::span);
        let [start, end] = spans.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]).unwrap_or_default();
        let frames = ((end - start) * fps - NEAR).ceil().max(0.0) + 1.0;
        // Files that list as many keys or values may have as many.
        let stated = self.timed().map(|channel| [channel.times.len(), channel.values.len()]);
        let [keys, values] = stated.fold([0, 0], |a, b| [a[0].max(b[0]), a[1] + b[1]]);
        let [first, last] = [start, end].map(|time| time as f32);
        let what = format!("animation '{}' is too long: keys from {first:e} s to {last:e} s", self.name);
        let remedy = "2^20 frames and 2^24 weights are the most; sample it with fewer a second, or split it";
        let fits = frames <= FRAMES_MAX.max(keys) as f64 && frames * width as f64 <= VALUES_MAX.max(values) as f64;
        ensure!(fits, what, remedy);
        Ok((0..frames as usize).map(move |frame| (start + frame as f64 / fps).min(end)))
    }
}

/// The most frames of a clip, and the most weights.
const FRAMES_MAX: usize = 1 << 20;
const VALUES_MAX: usize = 1 << 24;

impl Property {
    fn of(path: &str) -> Option<Self> {
        Some(match path {
            "translation" => Self::Translation,
            "rotation" => Self::Rotation,
            "scale" => Self::Scale,
            "weights" => Self::Weights,
            _ => return None,
        })
    }
}

/// Returns the nodes, the property and, if it is the only one, the target that a JSON pointer names:
/// `/nodes/N/PROPERTY`, `/meshes/N/weights`, or `/weights/K` of either. `taking` are the nodes that take the weights of
/// each mesh.
fn driven(pointer: &str, taking: &[Vec<usize>]) -> Option<(Vec<usize>, Property, Option<usize>)> {
    let parts: Vec<&str> = pointer.strip_prefix('/')?.split('/').collect();
    let (&[list, number, property], element) = parts.split_first_chunk()?;
    let number: usize = number.parse().ok()?;
    let property = Property::of(property)?;
    let target = match element {
        [] => None,
        [target] => Some(target.parse().ok()?),
        _ => return None,
    };
    let nodes = match (list, property, target) {
        ("nodes", Property::Weights, _) | ("nodes", _, None) => vec![number],
        ("meshes", Property::Weights, _) => taking.get(number)?.clone(),
        _ => return None,
    };
    Some((nodes, property, target))
}

/// Reads the channels of an animation. `targets` are the numbers of morph targets of the mesh of each node; `taking`
/// are the nodes that take the weights of each mesh.
pub fn channels(file: &Container, at: &At<'_>, targets: &[usize], taking: &[Vec<usize>]) -> Result<Vec<Channel>> {
    let mut found = vec![];
    let mut left_out = 0;
    let mut why = "";
    for stated in at.items("channels")? {
        let target = stated.need("target")?;
        let path = target.text_or_empty("path");
        let pointer = match (path, target.get("node")) {
            ("pointer", _) => {
                let extension = target.extension("KHR_animation_pointer");
                extension.map_or(String::new(), |pointer| pointer.text_or_empty("pointer").to_owned())
            }
            (_, Some(node)) => format!("/nodes/{}/{path}", file.root().index_of("nodes", &node)?),
            (_, None) => String::new(),
        };
        let mut drives = false;
        if let Some((nodes, property, target)) = driven(&pointer, taking) {
            file.charge(&stated, nodes.len(), 2 * size_of::<Channel>())?;
            for node in nodes.into_iter().filter(|node| *node < targets.len()) {
                let all = targets[node];
                let width = match property {
                    Property::Translation | Property::Scale => 3,
                    Property::Rotation => 4,
                    Property::Weights if target.is_some_and(|target| target >= all) => 0,
                    Property::Weights => target.map_or(all, |_| 1),
                };
                if width > 0 {
                    drives = true;
                    let read = channel(file, at, &stated, (node, property, target), width);
                    found.extend(file.leave_out(read, "channel")?.flatten());
                }
            }
        }
        if !drives {
            left_out += 1;
            if path == "pointer" {
                why = " (KHR_animation_pointer is read for weights and for transforms of nodes)";
            }
        }
    }
    if left_out > 0 {
        file.note(at, format!("channels of no morph target or node, left out{why}: {left_out}"));
    }
    Ok(found)
}

/// Reads a channel; `None` if it has no keys.
fn channel(
    file: &Container,
    at: &At<'_>,
    stated: &At<'_>,
    (node, property, target): (usize, Property, Option<usize>),
    width: usize,
) -> Result<Option<Channel>> {
    let sampler = at.item("samplers", &stated.need("sampler")?)?;
    let interpolation = match sampler.text_or_empty("interpolation") {
        "" | "LINEAR" => Interpolation::Linear,
        "STEP" => Interpolation::Step,
        "CUBICSPLINE" => Interpolation::CubicSpline,
        other => return Err(sampler.refuse(format!("interpolation '{other}'"), "use STEP, LINEAR or CUBICSPLINE")),
    };
    let input = file.accessor(&sampler.need("input")?)?;
    let times = input.floats::<1>()?.into_flattened();
    if times.is_empty() {
        file.note(stated, "no keys, left out");
        return Ok(None);
    }
    for (i, two) in times.windows(2).enumerate() {
        let what = || format!("key {} at {} s comes after key {i} at {} s", i + 1, two[1], two[0]);
        ensure!(two[0] <= two[1], input.at.refuse(what(), "list keys in the order of their times"));
    }
    let output = file.accessor(&sampler.need("output")?)?;
    let values_per_key = if interpolation == Interpolation::CubicSpline { 3 } else { 1 };
    // Weights are stored as scalars, one after the other; the other properties as vectors.
    let scalars = if property == Property::Weights { width } else { 1 };
    let output = output.of_count(times.len() * values_per_key * scalars, "values for all keys")?;
    let values = match property {
        Property::Weights => output.floats::<1>()?.into_flattened(),
        Property::Translation | Property::Scale => output.floats::<3>()?.into_flattened(),
        Property::Rotation => output.floats::<4>()?.into_flattened(),
    };
    Ok(Some(Channel { node, property, target, interpolation, times, values }))
}
