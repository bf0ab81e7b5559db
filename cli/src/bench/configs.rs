//! Which configurations there are: paths, formats, modes, sums and batch sizes that go together.

use super::record::Skipped;
use super::setting::Config;
use crate::args::UpdateArgs;
use crate::args::values::{BatchSpec, expand_batches, format_on};
use crate::runner::Gpu;
use deltamorph::{Accumulate, BatchSize, DeltaFormat, UpdateDesc, UpdateMode, UpdatePath};

/// What is asked for.
#[derive(Default)]
pub struct Wanted<'a> {
    pub paths: Vec<UpdatePath>,
    /// They were given by name, so that one that has nothing to do is worth a word.
    pub paths_named: bool,
    /// The formats; each path takes those that it can.
    pub formats: &'a [DeltaFormat],
    /// Kinds of sums; each format takes those that it can.
    pub sums: &'a [Accumulate],
    /// The modes; none: that of each path.
    pub modes: Vec<UpdateMode>,
    /// Targets per pass.
    pub sizes: &'a [BatchSpec],
    /// The sizes were given by name, so that one that a path does not have is worth a word.
    pub sizes_named: bool,
    /// A length; for block formats.
    pub error_budget: f32,
}

/// What can run, and what was asked for and cannot, with the reason.
pub fn configurations(wanted: &Wanted<'_>, update: &UpdateArgs, gpu: Option<&Gpu>) -> (Vec<Config>, Vec<Skipped>) {
    let (mut configs, mut skipped) = (vec![], vec![]);
    for &path in &wanted.paths {
        let modes = if wanted.modes.is_empty() { vec![path.default_mode()] } else { wanted.modes.clone() };
        let available = match (path, gpu) {
            (UpdatePath::Cpu, _) => Ok(()),
            (_, Some(gpu)) => gpu.caps().check_path(path).map_err(|e| e.to_string()),
            (_, None) => Err("there is no Vulkan device; the path 'cpu' needs none".into()),
        };
        if let Err(reason) = available {
            skipped.push(Skipped { what: path.name().into(), reason });
            continue;
        }
        let before = (configs.len(), skipped.len());
        for format in wanted.formats.iter().filter_map(|f| format_on(path, *f)) {
            let batch_max = gpu.and_then(|gpu| gpu.caps().batch_max(path, format));
            let max = batch_max.unwrap_or(0);
            // A draw takes the active targets, whatever their number: there is nothing to sweep.
            let direct = path == UpdatePath::DirectAttributes && !wanted.sizes_named;
            let sizes: &[BatchSpec] = if direct { &[BatchSpec::Max] } else { wanted.sizes };
            let (batches, refused) = expand_batches(sizes, path, max);
            for batch in batches {
                for (mode, sums) in modes.iter().flat_map(|m| held(wanted.sums, path, format).map(move |s| (*m, s))) {
                    let desc = UpdateDesc::new(path, batch)
                        .mode(mode)
                        .slots(update.slots)
                        .accumulate(update.sums(sums))
                        .error_budget(if format.is_blocks() { wanted.error_budget } else { 0.0 });
                    match desc.check() {
                        // Two names for one format are one configuration.
                        Ok(()) if configs.iter().any(|c: &Config| (c.desc, c.format) == (desc, format)) => {}
                        Ok(()) => configs.push(Config { desc, format, batch_max, separate: false }),
                        Err(e) => {
                            let what = format!("{} batch {batch}", path.name());
                            skipped.push(Skipped { what, reason: e.to_string() });
                        }
                    }
                }
            }
            // `all` is in the default list; that feedback has no such thing is no news.
            let named = |b: &&BatchSize| **b != BatchSize::All && wanted.sizes_named;
            let refused: Vec<&BatchSize> = refused.iter().filter(named).collect();
            if let (Some(first), Some(last)) = (refused.first(), refused.last()) {
                let sizes = if first == last { first.to_string() } else { format!("{first} to {last}") };
                skipped.push(Skipped {
                    what: format!("{} {} batch {sizes}", path.name(), format.name()),
                    reason: format!("the device allows at most {max} targets per pass"),
                });
            }
        }
        if wanted.paths_named && before == (configs.len(), skipped.len()) {
            let formats: Vec<&str> = path.formats().iter().map(|format| format.name()).collect();
            let sums = match path {
                UpdatePath::Scatter => "exact",
                UpdatePath::Blocks | UpdatePath::Cpu => "float (or exact, as fast and small)",
                _ => "float",
            };
            let reason = format!("takes --formats {} and --accumulate {sums}", formats.join(","));
            skipped.push(Skipped { what: path.name().into(), reason });
        }
    }
    (configs, skipped)
}

/// Those of `sums` that `format` has. What only blocks have is no news where everything was asked for.
fn held(sums: &[Accumulate], path: UpdatePath, format: DeltaFormat) -> impl Iterator<Item = Accumulate> {
    let exact = format.has_integers();
    sums.iter().copied().filter(move |sums| match sums {
        Accumulate::Float { .. } => path != UpdatePath::Scatter,
        Accumulate::Exact => exact,
    })
}
