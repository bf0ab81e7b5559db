//! Work that keeps a GPU's clocks up while it is timed.

use super::Headless;
use super::bandwidth::Reading;
use super::wait::full_barrier;
use deltamorph::Result;
use deltamorph::ash::vk;
use std::cell::Cell;
use std::time::{Duration, Instant};

/// Work that runs before what is timed; see [`Headless::keep_clocks_up`].
pub struct Load {
    reading: Reading,
    /// Duration of a pass.
    pass: Duration,
    /// When what was timed last had ended.
    ended: Cell<Instant>,
    /// Milliseconds of the load before it: recording and running.
    pub ms: Cell<f64>,
}

/// Of the load: what remains in the caches of a GPU, beside what is timed.
const LOAD_BYTES: u64 = 4 << 20;
/// How long a GPU that was idle takes to raise its clocks, and more.
const SETTLING: Duration = Duration::from_millis(300);
/// The shortest load.
const LEAST: Duration = Duration::from_millis(2);

impl Load {
    /// Records work for half as long as the device had none.
    pub fn record(&self, cmd: vk::CommandBuffer) {
        let begun = Instant::now();
        let time = (self.ended.get().elapsed() / 2).clamp(LEAST, SETTLING);
        let passes = time.as_nanos().div_ceil(self.pass.as_nanos().max(1));
        (0..passes).for_each(|_| self.reading.read(cmd));
        full_barrier(&self.reading.objects.device.raw, cmd, vk::PipelineStageFlags::ALL_COMMANDS);
        self.ms.set(begun.elapsed().as_secs_f64() * 1e3);
    }

    /// Ends what was timed; `ms`: how long the device worked before.
    pub fn end(&self, ms: f64) {
        self.ms.set(self.ms.get() + ms);
        self.ended.set(Instant::now());
    }
}

impl Headless {
    /// From now on lets the device work before each timed submission, for half as long as it was idle. A GPU lowers its
    /// clocks between frames that leave it idle, to a sixth of their rate, and what it is timed at then depends on how
    /// long the host took. Software drivers have no clocks of their own.
    ///
    /// # Errors
    /// Out of memory; the device fails.
    pub fn keep_clocks_up(&self) -> Result<()> {
        if self.caps().is_software() { Ok(()) } else { self.keep_busy() }
    }

    /// [`keep_clocks_up`](Self::keep_clocks_up) whatever the device.
    ///
    /// # Errors
    /// As there.
    #[doc(hidden)]
    pub fn keep_busy(&self) -> Result<()> {
        const PASSES: u32 = 100;
        let reading = Reading::new(self, LOAD_BYTES)?;
        let (begun, mut pass) = (Instant::now(), Duration::MAX);
        while begun.elapsed() < SETTLING {
            let start = Instant::now();
            self.submitter.run(|cmd| {
                (0..PASSES).for_each(|_| reading.read(cmd));
                Ok(())
            })?;
            pass = pass.min(start.elapsed() / PASSES);
        }
        let (ended, ms) = (Cell::new(Instant::now()), Cell::new(0.0));
        self.submitter.load.get_or_init(|| Load { reading, pass, ended, ms });
        Ok(())
    }
}
