//! [`Calls`]: what a host called on a crowd, as text, for `deltamorph replay` to repeat on another driver.
//!
//! The first two lines name the format and the crowd; then there is a line for each call, such as `weights 0 3=0.25`.

use crate::error::{Error, Result};
use crate::io::{TEXT_MAX, read_bounded};
use crate::pack::{DeltaFormat, PackedLayout, PoseFormat};
use crate::plan::{BatchSize, UpdateDesc, UpdateMode, UpdatePath};
use std::fmt::{self, Display, Formatter};
use std::path::Path;
use std::str::{FromStr, SplitWhitespace};

const FORMAT: &str = "deltamorph calls 1";
const REMEDY: &str = "give a file as it was written from take_calls()";

/// A call on a crowd with weights set by the host. `u32`: the instance.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Call {
    /// [`set_weights`](crate::CrowdBase::set_weights): targets whose requested weight changed, and the new weights.
    Weights(u32, Vec<(u32, f32)>),
    /// [`cut`](crate::CrowdBase::cut).
    Cut(u32),
    /// [`set_hidden`](crate::CrowdBase::set_hidden).
    Hidden(u32, bool),
    /// [`add`](crate::CrowdBase::add).
    Add,
    /// [`remove`](crate::CrowdBase::remove).
    Remove(u32),
    /// [`set_error_budget`](crate::CrowdBase::set_error_budget).
    ErrorBudget(u32, f32),
    /// An update was recorded, or carried out by a [`CpuCrowd`](crate::CpuCrowd).
    Update,
    /// [`discard`](crate::DeviceCrowd::discard): this update, counted from 1 in the log, and later ones never ran.
    Discard(u64),
}

impl Display for Call {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Weights(instance, weights) => {
                write!(f, "weights {instance}")?;
                weights.iter().try_for_each(|(target, weight)| write!(f, " {target}={weight}"))
            }
            Self::Cut(instance) => write!(f, "cut {instance}"),
            Self::Hidden(instance, true) => write!(f, "hide {instance}"),
            Self::Hidden(instance, false) => write!(f, "show {instance}"),
            Self::Add => f.write_str("add"),
            Self::Remove(instance) => write!(f, "remove {instance}"),
            Self::ErrorBudget(instance, budget) => write!(f, "budget {instance} {budget}"),
            Self::Update => f.write_str("update"),
            Self::Discard(update) => write!(f, "discard {update}"),
        }
    }
}

impl Call {
    /// Reads a line; `None` if it is not a call.
    fn parse(line: &str) -> Option<Self> {
        fn next<T: FromStr>(words: &mut SplitWhitespace<'_>) -> Option<T> {
            words.next()?.parse().ok()
        }
        let mut words = line.split_whitespace();
        let words = &mut words;
        let call = match words.next()? {
            "weights" => {
                let instance = next(words)?;
                let weight =
                    |word: &str| word.split_once('=').and_then(|(t, w)| Some((t.parse().ok()?, w.parse().ok()?)));
                Self::Weights(instance, words.map(weight).collect::<Option<_>>()?)
            }
            "cut" => Self::Cut(next(words)?),
            "hide" => Self::Hidden(next(words)?, true),
            "show" => Self::Hidden(next(words)?, false),
            "add" => Self::Add,
            "remove" => Self::Remove(next(words)?),
            "budget" => Self::ErrorBudget(next(words)?, next(words)?),
            "update" => Self::Update,
            "discard" => Self::Discard(next(words)?),
            _ => return None,
        };
        words.next().is_none().then_some(call)
    }
}

/// The calls of a crowd, from [`CrowdBase::log_calls`](crate::CrowdBase::log_calls) on.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Calls {
    /// The description that the crowd was created with.
    pub update: UpdateDesc,
    /// The delta format of its mesh.
    pub format: DeltaFormat,
    /// Number of instances.
    pub instances: u32,
    /// Number that [`Calls::check`] compares.
    mesh: u32,
    /// The calls, without updates that were discarded and without [`Call::Discard`].
    pub calls: Vec<Call>,
}

impl Calls {
    /// Reads a file with the text of [`take_calls`](crate::CrowdBase::take_calls), all parts one after the other.
    ///
    /// # Errors
    /// A file that cannot be read; the line that is not what [`take_calls`](crate::CrowdBase::take_calls) writes.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = read_bounded(path, TEXT_MAX, REMEDY)?;
        let text = String::from_utf8_lossy(&bytes);
        let wrong = |line: usize, what: &str| {
            let found = text.lines().nth(line).unwrap_or("the end of the file");
            Error::input(path, format!(": line {}", line + 1), format!("{what}, found '{found}'"), REMEDY)
        };
        if text.lines().next() != Some(FORMAT) {
            return Err(wrong(0, &format!("expected '{FORMAT}'")));
        }
        let crowd = text.lines().nth(1).and_then(Self::crowd).ok_or_else(|| wrong(1, "expected a crowd"))?;
        let (mut calls, mut updates) = (vec![], 0);
        for (line, words) in text.lines().enumerate().skip(2) {
            let call = Call::parse(words).ok_or_else(|| wrong(line, "expected a call"))?;
            if let Call::Discard(first) = call {
                calls.retain(|(call, update)| *call != Call::Update || *update < first);
            } else {
                updates += u64::from(call == Call::Update);
                calls.push((call, updates));
            }
        }
        Ok(Self { calls: calls.into_iter().map(|(call, _)| call).collect(), ..crowd })
    }

    /// Reads the line of the crowd; `None` if a word of it is wrong.
    fn crowd(line: &str) -> Option<Self> {
        let mut words = line.strip_prefix("crowd ")?.split(' ');
        let mut value = |name: &str| words.next()?.strip_prefix(name)?.strip_prefix('=');
        let mesh = u32::from_str_radix(value("mesh")?, 16).ok()?;
        let format = value("format")?.parse().ok()?;
        let instances = value("instances")?.parse().ok()?;
        let path = named(&UpdatePath::ALL, UpdatePath::name, value("path")?)?;
        let batch = match value("batch")? {
            "all" => BatchSize::All,
            number => BatchSize::Targets(number.parse().ok()?),
        };
        let mode = named(&[UpdateMode::Incremental, UpdateMode::Rebuild], UpdateMode::name, value("mode")?)?;
        let slots = value("slots")?.parse().ok()?;
        let pose = named(&PoseFormat::ALL, PoseFormat::name, value("pose")?)?;
        let tolerance = value("tolerance")?.parse().ok()?;
        let weight_max = match value("weight_max")? {
            "default" => None,
            number => Some(number.parse().ok()?),
        };
        let error_budget = value("error_budget")?.parse().ok()?;
        let update = UpdateDesc { path, batch, mode, slots, pose, tolerance, weight_max, error_budget };
        Some(Self { update, format, instances, mesh, calls: vec![] })
    }

    /// Checks that a mesh is the one of the crowd: names of targets, steps of deltas, vertices and delta format.
    ///
    /// # Errors
    /// It is another.
    pub fn check(&self, layout: &PackedLayout) -> Result<()> {
        if self.mesh == number(layout) {
            return Ok(());
        }
        let text = format!("the calls are of another mesh than '{}', or of one packed in another way", layout.name);
        Err(Error::invalid(text, "give the packed file that the crowd was made from"))
    }
}

/// The one of `all` with this name.
fn named<T: Copy>(all: &[T], name: fn(T) -> &'static str, value: &str) -> Option<T> {
    all.iter().copied().find(|one| name(*one) == value)
}

/// A number that meshes of different targets, sizes or formats hardly share.
fn number(layout: &PackedLayout) -> u32 {
    let mut hash = crc32fast::Hasher::new();
    hash.update(format!("{} {}", layout.format.name(), layout.vertex_count).as_bytes());
    for target in &layout.targets {
        hash.update(target.name.as_bytes());
        hash.update(&target.position_step.to_le_bytes());
    }
    hash.finalize()
}

/// Where a crowd logs its calls. As a trait, what writes text is left out of programs that never log.
pub(crate) trait LogCalls: Send + Sync {
    fn add(&mut self, call: &Call);

    /// Adds weights if they differ from those before.
    fn add_weights(&mut self, instance: u32, before: &[f32], weights: &[f32]);

    /// Logs that update number `first` of the crowd and later ones never run.
    fn discard_from(&mut self, first: u64);

    /// The text since it was last taken.
    fn take(&mut self) -> String;
}

/// The text of calls, as it is collected.
pub(crate) struct CallLog {
    text: String,
    /// Updates before the first that is logged.
    before: u64,
}

impl CallLog {
    pub fn new(update: &UpdateDesc, instances: usize, layout: &PackedLayout, before: u64) -> Self {
        let UpdateDesc { path, batch, mode, slots, pose, tolerance, weight_max, error_budget } = update;
        let weight_max = weight_max.map_or("default".into(), |most| most.to_string());
        let (mesh, format, path, mode, pose) =
            (number(layout), layout.format.name(), path.name(), mode.name(), pose.name());
        let text = format!(
            "{FORMAT}\ncrowd mesh={mesh:08x} format={format} instances={instances} path={path} batch={batch} mode={mode} \
             slots={slots} pose={pose} tolerance={tolerance} weight_max={weight_max} error_budget={error_budget}\n"
        );
        Self { text, before }
    }
}

impl LogCalls for CallLog {
    fn add(&mut self, call: &Call) {
        self.text += &format!("{call}\n");
    }

    fn add_weights(&mut self, instance: u32, before: &[f32], weights: &[f32]) {
        let differs = |(before, after): &(&f32, &f32)| before.to_bits() != after.to_bits();
        let changed = (0..).zip(before.iter().zip(weights)).filter(|(_, pair)| differs(pair));
        let changed: Vec<_> = changed.map(|(target, (_, weight))| (target, *weight)).collect();
        if !changed.is_empty() {
            self.add(&Call::Weights(instance, changed));
        }
    }

    fn discard_from(&mut self, first: u64) {
        self.add(&Call::Discard(first.saturating_sub(self.before)));
    }

    fn take(&mut self) -> String {
        std::mem::take(&mut self.text)
    }
}
