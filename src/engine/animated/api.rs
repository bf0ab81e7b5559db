//! Crowds that are animated on the GPU: how to make one, and what it is told.

use super::Animated;
use crate::animation::{AnimationDesc, Clips, Playback, check_update};
use crate::engine::crowd::{Backend, Crowd, CrowdDesc};
use crate::engine::{GpuMesh, Kernel, MorphEngine};
use crate::error::{Error, Result};
use ash::vk;

impl MorphEngine {
    /// Make a crowd whose heads play clips on the GPU, and record the upload of the clips. Each update samples every
    /// head at the time set, plans, and carries the plan out; the CPU records the same commands whatever changes.
    ///
    /// Sums are exact: they do not drift, and there is no bound to keep. With an error budget, changes wait target by
    /// target ([`Budget`](crate::animation::Budget)). Slots always rotate. Heads that have played
    /// nothing yet show the base pose. What an update wrote only the GPU knows: [`UpdateStats`](crate::plan::UpdateStats)
    /// count a pass, and nothing else. There is no ring of lists either: any number of updates may be in flight.
    ///
    /// An update that is [discarded](Crowd::discard) changed nothing: the poses are those of the update before, and the
    /// next update does what it would have done. Only heads that it added have no pose until then, and such as came and
    /// went several times in the updates discarded.
    ///
    /// This records: a copy and two fills, and a barrier that makes them visible to updates (first stage TRANSFER with
    /// TRANSFER_WRITE; last COMPUTE_SHADER).
    ///
    /// The caller is responsible for: submitting `cmd` before any update of the crowd, and calling
    /// [`Crowd::release_staging`] once it has run.
    ///
    /// # Errors
    /// As [`create_crowd`](Self::create_crowd) and [`Clips::new`]; float sums, more than 32 slots; more
    /// instances, clips or entries than the device's storage range holds, with the numbers. Nothing is recorded then.
    ///
    /// # Safety
    /// - `cmd` is a primary command buffer in the recording state on the engine's device, outside a render pass and without
    ///   active conditional rendering, on a queue with graphics and compute.
    /// - It runs before any update of the crowd, exactly once; where it never does, the crowd is not updated.
    /// - The value returned is dropped only when the device no longer uses it.
    pub unsafe fn create_animated_crowd(
        &self,
        cmd: vk::CommandBuffer,
        mesh: &GpuMesh,
        desc: &CrowdDesc,
        animation: &AnimationDesc<'_>,
    ) -> Result<Crowd> {
        self.check_crowd(mesh, desc)?;
        check_update(&desc.update, mesh.layout())?;
        let clips = Clips::new(animation, mesh.layout())?;
        // Tiles are filled up to the next width, so that there has to be one.
        let tiled = CrowdDesc { instances: desc.instances.max(2).next_power_of_two(), ..*desc };
        let Kernel::Blocks(update) = self.kernel(&tiled, mesh)? else { unreachable!("the path is 'blocks'") };
        let kernels = (self.animation_kernel()?, update);
        let (device, shared) = (&self.device, &mesh.shared);
        let crowd = Crowd::with_backend(device, shared, desc, |poses| {
            Ok(Backend::Animated(Box::new(Animated::new(device, shared, kernels, clips, desc, poses)?)))
        })?;
        if let Backend::Animated(animated) = &crowd.backend {
            // SAFETY: the caller's obligations.
            unsafe { animated.upload(device, cmd) };
        }
        Ok(crowd)
    }
}

impl Crowd {
    /// Play a clip from the next recorded update on (crowds that are animated on the GPU).
    ///
    /// # Errors
    /// An instance or clip out of range; a speed or start that is no number or too large; a crowd whose weights are set
    /// by [`set_weights`](Self::set_weights).
    pub fn play(&mut self, instance: u32, playback: &Playback) -> Result<()> {
        self.check_instance(instance)?;
        let animated = self.animated("playing a clip")?;
        animated.heads.play(instance, playback, &animated.clips)
    }

    /// The clock is at `seconds` when the next recorded update runs (crowds that are animated on the GPU).
    ///
    /// # Errors
    /// No number, or one too large; more than 4.5 hours before some head starts; a crowd whose weights are set by
    /// [`set_weights`](Self::set_weights).
    pub fn set_time(&mut self, seconds: f64) -> Result<()> {
        self.animated("a clock")?.heads.set_time(seconds)
    }

    /// Give the staging memory of the clips back.
    ///
    /// # Safety
    /// The upload that [`create_animated_crowd`](MorphEngine::create_animated_crowd) recorded has run, or never will: its
    /// copies read the memory.
    pub unsafe fn release_staging(&mut self) {
        if let Backend::Animated(animated) = &mut self.backend {
            animated.staging = None;
        }
    }

    /// The clips that heads can play: what their keys lost, and how long they are. `None` for crowds whose weights are
    /// set.
    pub fn clips(&self) -> Option<&Clips> {
        match &self.backend {
            Backend::Animated(animated) => Some(&animated.clips),
            _ => None,
        }
    }

    pub(crate) fn animated(&mut self, what: &str) -> Result<&mut Animated> {
        match &mut self.backend {
            Backend::Animated(animated) => Ok(animated),
            _ => Err(Error::invalid(
                format!("{what} in a crowd whose weights are set"),
                "make the crowd with create_animated_crowd",
            )),
        }
    }
}
