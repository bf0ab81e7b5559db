//! The threads of the cpu path.

use crate::error::Result;
use crate::mesh::packed::{POSE_FLOATS, VERTEX_PADDING};

/// Pieces per thread: a thread that wakes late, or shares its core, leaves its pieces to the others.
const PIECES: usize = 8;
/// Vertices of a piece, at least: below this, handing it out costs more than computing it.
const PIECE_VERTICES: usize = 8 * VERTEX_PADDING;

/// The caller's thread and, with the feature `threads`, others that help it.
pub(super) struct Workers {
    /// All but the caller's.
    #[cfg(feature = "threads")]
    helpers: Option<rayon::ThreadPool>,
}

#[cfg(feature = "threads")]
impl Workers {
    /// `threads` in all; 0 takes one per core.
    pub(super) fn new(threads: usize) -> Result<Self> {
        let threads = match threads {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            n => n,
        };
        if threads == 1 {
            return Ok(Self { helpers: None });
        }
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads - 1).build().map_err(|e| {
            crate::Error::invalid(format!("{threads} threads cannot be started: {e}"), "ask for fewer threads")
        })?;
        Ok(Self { helpers: Some(pool) })
    }

    /// Cut `floats` (whole vertices) into pieces and call `f` with each and the index it starts at. The caller's
    /// thread begins at once; the others join as they wake.
    pub(super) fn for_each_piece(&self, floats: &mut [f32], f: impl Fn(usize, &mut [f32]) + Sync) {
        let helpers = self.helpers.as_ref().map_or(0, rayon::ThreadPool::current_num_threads);
        let vertices = floats.len() / POSE_FLOATS;
        let piece = vertices.div_ceil((helpers + 1) * PIECES).max(PIECE_VERTICES).next_multiple_of(VERTEX_PADDING);
        let size = piece * POSE_FLOATS;
        let queue = std::sync::Mutex::new(floats.chunks_mut(size).enumerate());
        let work = || {
            // A poisoned lock: another thread panicked in `f`, and the scope passes that on.
            while let Some((i, out)) = queue.lock().ok().and_then(|mut pieces| pieces.next()) {
                f(i * size, out);
            }
        };
        match &self.helpers {
            Some(pool) if vertices > piece => pool.in_place_scope(|scope| {
                (0..helpers).for_each(|_| scope.spawn(|_| work()));
                work();
            }),
            _ => work(),
        }
    }
}

#[cfg(not(feature = "threads"))]
impl Workers {
    /// The caller's thread, whatever `threads` asks for.
    pub(super) fn new(_threads: usize) -> Result<Self> {
        Ok(Self {})
    }

    /// Cut `floats` (whole vertices) into pieces and call `f` with each and the index it starts at.
    pub(super) fn for_each_piece(&self, floats: &mut [f32], f: impl Fn(usize, &mut [f32])) {
        let size = PIECES * PIECE_VERTICES * POSE_FLOATS;
        floats.chunks_mut(size).enumerate().for_each(|(i, out)| f(i * size, out));
    }
}
