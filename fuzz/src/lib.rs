//! The fuzz targets and their shared parts: bounds on memory and time, files in a folder of the process, comparison of
//! meshes with the reference. Nothing here needs libFuzzer: `cargo test` replays inputs without it.

mod check;
mod random;
pub mod targets;
#[path = "../../tests/common/testing.rs"]
mod testing;

pub use check::{check_error, pack_and_update, update};
pub use random::Random;

use rustix::time::{ClockId, clock_gettime};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// A function of the library that takes bytes from outside.
pub struct Target {
    pub name: &'static str,
    /// Processes an input. A panic is a finding.
    pub run: fn(&[u8]),
    /// Makes a new input from another one, by its structure; `None`: its bytes are to be mutated.
    pub mutate: fn(&[u8], &mut Random) -> Option<Vec<u8>>,
    /// Initial inputs: name and content.
    pub seeds: fn() -> Vec<(String, Vec<u8>)>,
}

/// The memory bound that a reader states for an input of a given size.
#[derive(Clone, Copy)]
pub struct Memory {
    pub base: usize,
    pub per_byte: usize,
}

/// Bound on the processor time of an input, in seconds: a constant, and a term per byte. Baking the largest possible
/// clip takes half a second.
const TIME: [f64; 2] = [2.0, 10e-6];

/// Runs `body` on an input of `input` bytes, and checks its memory and processor time against the bounds.
pub fn bounded<T>(what: &str, input: usize, memory: Memory, body: impl FnOnce() -> T) -> T {
    let start = processor_time();
    let mut result = None;
    let taken = allocation_counter::measure(|| result = Some(body())).bytes_max as usize;
    let seconds = processor_time() - start;
    let most = memory.base + memory.per_byte * input;
    tell_largest(what, input, taken, most);
    assert!(taken <= most, "{what}: {taken} bytes of memory for an input of {input} bytes, at most {most} are stated");
    let longest = TIME[0] + TIME[1] * input as f64;
    assert!(
        seconds <= longest,
        "{what}: {seconds:.2} s for an input of {input} bytes, at most {longest:.2} are allowed"
    );
    result.expect("the body has run")
}

/// Prints each new largest share of the memory bound to stderr, where the script `run` finds the last one.
fn tell_largest(what: &str, input: usize, taken: usize, most: usize) {
    static LARGEST: AtomicU64 = AtomicU64::new(0);
    let permille = (taken * 1000 / most) as u64;
    if LARGEST.fetch_max(permille, Relaxed) < permille {
        eprintln!("LARGEST MEMORY: {what}: {taken} B for {input} B, {:.3} of {most} B", permille as f64 / 1000.0);
    }
}

/// Returns the processor time of this thread, in seconds.
fn processor_time() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// Returns the folder of this thread for files; the script `run` puts it in memory.
pub fn scratch() -> PathBuf {
    let thread = std::thread::current();
    let name = format!("deltamorph-fuzz-{}-{}", std::process::id(), thread.name().unwrap_or("").replace("::", "-"));
    let folder = std::env::temp_dir().join(name);
    std::fs::create_dir_all(&folder).expect("a folder for files");
    folder
}

/// Writes a file into [`scratch`].
pub fn write(name: &str, bytes: &[u8]) -> PathBuf {
    let path = scratch().join(name);
    std::fs::write(&path, bytes).expect("a file");
    path
}

/// Splits an input at zero bytes into at most `N` parts; the last has the rest.
pub fn parts<const N: usize>(data: &[u8]) -> [&[u8]; N] {
    let mut parts = data.splitn(N, |byte| *byte == 0);
    std::array::from_fn(|_| parts.next().unwrap_or_default())
}
