//! What the processor's memory can do, measured with the same threads as the cpu path.

use rayon::prelude::*;
use std::hint::black_box;
use std::time::Instant;

const RUNS: usize = 12;
/// Words handed out at a time: enough pieces for threads to share evenly.
const PIECE: usize = 1 << 15;

/// Read and copy bandwidth in 10⁹ bytes per second (a copy counts bytes read and written) over `bytes`, as many
/// as the deltas have, so that the workload finds no more of them in a cache than this does: the best of a few
/// runs on `threads` threads (0: one per core). `None` when the threads cannot be started.
pub fn measure(bytes: u64, threads: usize) -> Option<(f64, f64)> {
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

/// Streams that a piece is read as, side by side: one alone does not keep the prefetchers busy, and the cpu path
/// reads as many targets at once.
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
