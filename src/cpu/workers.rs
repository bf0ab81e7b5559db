//! Threads of path `cpu`.

use crate::error::Result;
use crate::pack::VERTEX_PADDING;

/// Pieces per thread: threads that wake late, or share a core, leave theirs to the others.
const PIECES: usize = 8;
/// Fewest vertices of a piece; scheduling less costs more than computing it.
const PIECE_VERTICES: usize = 8 * VERTEX_PADDING;
/// Vertices of a piece when several instances are updated: 72 targets in float32 take 442 KB.
const SHARED_VERTICES: usize = 4 * VERTEX_PADDING;

/// The calling thread and, with the feature `threads`, helper threads.
pub(crate) struct Workers {
    /// Without the calling thread; `None`: no helpers.
    #[cfg(feature = "threads")]
    helpers: Option<rayon::ThreadPool>,
}

#[cfg(feature = "threads")]
impl Workers {
    /// `threads` in total; 0: one per core.
    pub fn new(threads: usize) -> Result<Self> {
        let threads = match threads {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            n => n,
        };
        if threads == 1 {
            return Ok(Self { helpers: None });
        }
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads - 1).build().map_err(|e| {
            crate::error::Error::invalid(format!("{threads} threads cannot be started: {e}"), "ask for fewer threads")
        })?;
        Ok(Self { helpers: Some(pool) })
    }

    /// Number of threads, including the calling one.
    pub fn threads(&self) -> usize {
        1 + self.helpers.as_ref().map_or(0, rayon::ThreadPool::current_num_threads)
    }

    /// Calls `f` with every job. The calling thread starts at once; helpers join as they wake, if there are several
    /// jobs.
    pub fn for_each<J: Send>(&self, jobs: impl Iterator<Item = J> + Send, f: impl Fn(J) + Sync) {
        let mut jobs = jobs.peekable();
        let first = jobs.next();
        let more = jobs.peek().is_some();
        let queue = std::sync::Mutex::new(jobs);
        let work = |first: Option<J>| {
            first.into_iter().for_each(&f);
            // A poisoned lock: `f` panicked on another thread, and the scope will propagate it.
            while let Some(job) = queue.lock().ok().and_then(|mut jobs| jobs.next()) {
                f(job);
            }
        };
        match &self.helpers {
            Some(pool) if more => pool.in_place_scope(|scope| {
                (1..self.threads()).for_each(|_| scope.spawn(|_| work(None)));
                work(first);
            }),
            _ => work(first),
        }
    }
}

#[cfg(not(feature = "threads"))]
impl Workers {
    /// The calling thread only; ignores `threads`.
    pub fn new(_threads: usize) -> Result<Self> {
        Ok(Self {})
    }

    /// Number of threads: 1.
    pub fn threads(&self) -> usize {
        1
    }

    /// Calls `f` with every job.
    pub fn for_each<J>(&self, jobs: impl Iterator<Item = J>, f: impl Fn(J)) {
        jobs.for_each(f);
    }
}

impl Workers {
    /// Vertices of a piece of work, to update `instances` instances.
    pub fn piece_vertices(&self, vertices: usize, instances: usize) -> usize {
        // Deltas of a small piece stay cached for all instances.
        let shared = if instances > 1 { SHARED_VERTICES } else { usize::MAX };
        vertices.div_ceil(self.threads() * PIECES).max(PIECE_VERTICES).next_multiple_of(VERTEX_PADDING).min(shared)
    }
}
