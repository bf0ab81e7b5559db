//! The machine in a report: its device, its memory, and the date and command line of the measurement.

use super::record::{Bandwidth, DeviceInfo, Report};
use crate::args::bench::BenchArgs;
use crate::input::Input;
use crate::output::{Output, Result};
use crate::runner::{self, Gpu};
use deltamorph::DeltaFormat;
use deltamorph_headless::DeviceChoice;
use rayon::prelude::*;
use std::hint::black_box;
use std::time::{Instant, SystemTime, UNIX_EPOCH};

/// The measuring devices, and the options.
pub struct Machine<'a> {
    pub args: &'a BenchArgs,
    /// `None` without a device.
    pub gpu: Option<Gpu>,
    pub bandwidth: Bandwidth,
}

impl<'a> Machine<'a> {
    /// Opens the device, and measures bandwidth over as many bytes as the deltas of `input` have, so that caches help
    /// it as much as a configuration.
    pub fn open(args: &'a BenchArgs, device: Option<&DeviceChoice>, input: &Input, out: &Output) -> Result<Self> {
        let gpu = runner::open(device, out)?;
        if gpu.is_none() {
            out.warn("continuing with the path 'cpu'");
        }
        let spinner = out.spinner("measuring memory bandwidth");
        let largest = (input.kept.vertex_count() * input.kept.targets.len() * DeltaFormat::Float32.stride()) as u64;
        let (cpu_read_gb_s, cpu_copy_gb_s) = bandwidth(largest, args.update.threads.unwrap_or(0)).unzip();
        if let Some(gpu) = &gpu {
            gpu.keep_clocks_up()?;
        }
        let on_device = gpu.as_ref().map_or(Ok(None), |gpu| gpu.bandwidth(largest.max(1 << 20)))?;
        let (device_copy_gb_s, device_read_gb_s) = on_device.map(|b| (b.copy, b.read)).unzip();
        drop(spinner);
        let bandwidth = Bandwidth { cpu_read_gb_s, cpu_copy_gb_s, device_copy_gb_s, device_read_gb_s };
        Ok(Self { args, gpu, bandwidth })
    }

    /// A report without results.
    pub fn report(&self, input: &Input) -> Report {
        // The program's folder is omitted: it is specific to this machine.
        let add = |line: String, argument: std::ffi::OsString| line + " " + &quoted(&argument.to_string_lossy());
        Report {
            schema: 1,
            version: env!("CARGO_PKG_VERSION").into(),
            created: SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs()),
            command: std::env::args_os().skip(1).fold("deltamorph".into(), add),
            device: self.device(),
            input: input.info(),
            bandwidth: self.bandwidth,
            ..Report::default()
        }
    }

    fn device(&self) -> DeviceInfo {
        let cores = || std::thread::available_parallelism().map_or(1, usize::from);
        let cpu = DeviceInfo {
            name: "none".into(),
            kind: "none".into(),
            cpu: processor(),
            threads: self.args.update.threads.unwrap_or_else(cores),
            ..DeviceInfo::default()
        };
        let Some(caps) = self.gpu.as_ref().map(Gpu::caps) else { return cpu };
        let (major, minor, patch) = caps.api_version;
        DeviceInfo {
            name: caps.name.clone(),
            kind: crate::devices::kind(caps),
            driver: caps.driver.clone(),
            driver_info: caps.driver_info.clone(),
            api_version: format!("{major}.{minor}.{patch}"),
            ..cpu
        }
    }
}

/// The processor's name, if the system provides it.
fn processor() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find_map(|l| l.strip_prefix("model name")?.split_once(':'));
    // Windows names it in the environment.
    let other = || std::env::var("PROCESSOR_IDENTIFIER").unwrap_or_else(|_| std::env::consts::ARCH.to_owned());
    model.map_or_else(other, |(_, name)| name.trim().to_owned())
}

/// An argument quoted for the system's shell.
fn quoted(argument: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./,=:+@%".contains(c) || (cfg!(windows) && c == '\\');
    if !argument.is_empty() && argument.chars().all(plain) {
        return argument.to_owned();
    }
    if cfg!(windows) {
        return format!("\"{argument}\"");
    }
    format!("'{}'", argument.replace('\'', r"'\''"))
}

/// Bandwidths are the best of this many runs.
const RUNS: usize = 12;
/// Words per work item: enough pieces for threads to share evenly.
const PIECE: usize = 1 << 15;

/// Bandwidth of the processor's memory in 10⁹ bytes per second over `bytes`, reading and copying (bytes read and
/// written), on `threads` threads (0: one per core) like the cpu path; `None` if they cannot be started.
fn bandwidth(bytes: u64, threads: usize) -> Option<(f64, f64)> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().ok()?;
    let words = (bytes / 8).max(1 << 16) as usize;
    let from: Vec<u64> = (0..words as u64).collect();
    let mut to = vec![0u64; words];
    let (mut read, mut copy) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..RUNS {
        let start = Instant::now();
        black_box(pool.install(|| from.par_chunks(PIECE).map(sum).reduce(|| 0, u64::wrapping_add)));
        read = read.min(start.elapsed().as_secs_f64());
        let start = Instant::now();
        pool.install(|| to.par_chunks_mut(PIECE).zip(from.par_chunks(PIECE)).for_each(|(t, f)| t.copy_from_slice(f)));
        black_box(&mut to);
        copy = copy.min(start.elapsed().as_secs_f64());
    }
    let bytes = words as f64 * 8.0;
    Some((bytes / read * 1e-9, 2.0 * bytes / copy * 1e-9))
}

/// Streams read at once, as the cpu path reads targets: a single one does not keep the prefetchers busy.
const STREAMS: usize = 8;

fn sum(words: &[u64]) -> u64 {
    let length = words.len() / STREAMS;
    let streams: [&[u64]; STREAMS] = std::array::from_fn(|i| &words[i * length..][..length]);
    // Independent sums, so that the additions do not wait for each other.
    let mut sums = [0u64; 8];
    for i in 0..length / sums.len() {
        for stream in streams {
            for (sum, word) in sums.iter_mut().zip(&stream[i * 8..][..8]) {
                *sum = sum.wrapping_add(*word);
            }
        }
    }
    sums.iter().fold(0, |a, b| a.wrapping_add(*b))
}

#[cfg(test)]
mod tests {
    use super::quoted;

    #[test]
    #[cfg(unix)]
    fn arguments_survive_a_shell() {
        let quoted = ["--batch-sizes=1..7,all", "my face", "it's", ""].map(quoted);
        assert_eq!(quoted, ["--batch-sizes=1..7,all", "'my face'", r"'it'\''s'", "''"]);
    }
}
