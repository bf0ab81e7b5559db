//! Meshes whose targets come to the device and go, under a limit of memory.

use super::MorphEngine;
use super::upload::GpuMesh;
use crate::error::{Error, Result};
use crate::gpu::barriers;
use crate::gpu::mesh::{MeshBuffers, Upload};
use crate::pack::{PackedLayout, PackedMesh};
use crate::plan::schedule::{Barrier, targets_swapped};
use crate::residency::{Copied, Residency, Residents, TargetSwap};
use ash::vk;
use std::sync::Arc;

/// The copies of a swap of targets: the memory that they read and write. To be dropped when they have run, which may
/// be after the mesh; or handed to [`GpuMesh::discard_swap`] where they never will.
#[must_use = "the copies read its memory until they have run"]
pub struct SwapCopies {
    _staging: Option<Upload>,
    copied: Copied,
    bytes: u64,
    /// Kept alive.
    mesh: Arc<MeshBuffers>,
}

impl SwapCopies {
    /// Bytes that are copied to the device: of what came, and of what had to move for it. They lie in staging memory
    /// until this is dropped.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }
}

impl GpuMesh {
    /// Memory of a mesh whose targets come and go; `None` of one that was uploaded as a whole. As of the last
    /// [recorded](MorphEngine::record_swap) swap, whether it has run or not.
    pub fn residency(&self) -> Option<Residency> {
        self.groups[0].residents.as_ref().map(|residents| residents.bytes())
    }

    /// Whether weights of target `target` may be requested: all targets are there of a mesh that was uploaded as a
    /// whole, of others those that were loaded. As of the last recorded swap.
    pub fn is_resident(&self, target: usize) -> bool {
        match &self.groups[0].residents {
            Some(residents) => residents.is_resident(target),
            None => target < self.layout().targets.len(),
        }
    }

    /// A swap will never run: its command buffer is not submitted. What it copied is not there then; the next
    /// [`MorphEngine::record_swap`], be it of nothing, copies that again, and until then updates that need it are
    /// refused. Targets that it let go are gone. Updates recorded after it never run, either: they are
    /// [discarded](crate::Crowd::discard), too.
    ///
    /// # Errors
    /// A swap of another mesh.
    pub fn discard_swap(&mut self, swap: SwapCopies) -> Result<()> {
        match (&self.groups[0].residents, &swap.mesh.residents) {
            (Some(ours), Some(its)) if Arc::ptr_eq(ours, its) => ours.lose(&swap.copied),
            (Some(_) | None, _) => {
                return Err(Error::invalid(
                    "a swap of another mesh",
                    "discard it in the mesh whose targets it swapped",
                ));
            }
        }
        Ok(())
    }

    /// What knows which targets are there.
    fn residents(&self) -> Result<&Arc<Residents>> {
        self.groups[0].residents.as_ref().ok_or_else(|| {
            let text =
                format!("targets of mesh '{}', which was uploaded as a whole, are to come and go", self.layout().name);
            Error::invalid(text, "upload it with MorphEngine::upload_resident")
        })
    }
}

impl MorphEngine {
    /// Create the buffer of a mesh in blocks whose targets come and go, and record the upload of its base pose: no
    /// target is on the device yet. [`record_swap`](Self::record_swap) loads them, in the same command buffer or
    /// later.
    ///
    /// `resident_bytes` bounds the deltas that are on the device at a time: at least those of the largest target
    /// ([`PackedMesh::target_bytes`]), and as a rule those of all targets that are used at once.
    /// [`GpuMesh::residency`] says what the buffer takes; it is made here, and never grows. Crowds of the mesh are
    /// made by [`create_crowd`](Self::create_crowd) as of any other; they are on the path `blocks`, in any format of
    /// poses, and their updates take as long and have the same bits as with a mesh that was [uploaded](Self::upload)
    /// as a whole. Crowds [animated](Self::create_animated_crowd) on the GPU, which requests weights there, are
    /// refused. `examples/residency.rs` decides what comes and what goes.
    ///
    /// A weight other than 0 of a target that is not there is refused by whatever sets it, and by the update of a crowd
    /// that has requested it before the target went.
    ///
    /// This records: a fill, a copy for each group, and a barrier that makes them visible to updates and draws (first
    /// stage TRANSFER with TRANSFER_WRITE; last ALL_COMMANDS with MEMORY_READ and MEMORY_WRITE).
    ///
    /// The caller is responsible for: as with [`upload`](Self::upload).
    ///
    /// # Errors
    /// A dense format; fewer bytes than a target takes; a buffer that exceeds the device's storage range, which all of
    /// it has to be within; no memory. The message has the numbers, and nothing is recorded.
    ///
    /// # Safety
    /// As [`upload`](Self::upload).
    pub unsafe fn upload_resident(
        &self,
        cmd: vk::CommandBuffer,
        mesh: &PackedMesh,
        resident_bytes: u64,
    ) -> Result<GpuMesh> {
        mesh.groups().iter().try_for_each(|group| self.check_mesh(group.layout()))?;
        let residents = Arc::new(Residents::new(mesh, resident_bytes)?);
        let (name, Residency { buffer, .. }) = (&mesh.layout().name, residents.bytes());
        let what = format!("mesh '{name}' with {resident_bytes} bytes for its deltas takes");
        let range = self.device.caps.max_storage_range;
        self.device.caps.check_limit(&what, (buffer, "bytes", range), "allow fewer bytes, or split the mesh")?;
        let groups = MeshBuffers::resident(&self.device, mesh, &residents)?;
        let entries = 4 * u64::from(residents.words_of_entries());
        if let Some((first, _)) = groups.first().filter(|_| entries > 0) {
            // SAFETY: the caller's obligations; the range begins the buffer, is a multiple of 4, and no copy writes it.
            unsafe { self.device.raw.cmd_fill_buffer(cmd, first.deltas.raw, 0, entries, 0) };
        }
        // SAFETY: the caller's obligations.
        Ok(unsafe { self.upload_groups(cmd, groups) })
    }

    /// Let targets go, and load others. Whatever takes no more than is free in all finds a place: where no hole is
    /// large enough, targets that are there move, which is copied as well ([`SwapCopies::bytes`] has both). That is
    /// so in the format `small` alone, and little where some percent are left free.
    ///
    /// `source` is the packed mesh that was uploaded, or the same read again from its file: deltas are copied from
    /// it, and it may be dropped between swaps.
    ///
    /// A target cannot go while poses hold it: after the last recorded update of each crowd of the mesh, of all
    /// instances that have a pose, be they hidden. Record an update with its weight at 0 first; with an error budget
    /// a second one, of the same weights, since the first may defer some of it. Instances that were removed let go in
    /// the next update of their crowd, crowds when they are dropped, and so does what they had before they
    /// [grew](Self::grow_crowd).
    ///
    /// This records: a barrier (first stages TRANSFER and COMPUTE_SHADER, with TRANSFER_WRITE; last TRANSFER with
    /// TRANSFER_WRITE), copies, and a barrier (first TRANSFER with TRANSFER_WRITE; last COMPUTE_SHADER with
    /// SHADER_READ): updates recorded before it read what was there, updates recorded after it what is there then,
    /// also in one command buffer. Nothing where there is nothing to copy, as where targets only go.
    ///
    /// The caller is responsible for: submitting `cmd` once, after all updates and swaps of the mesh that were
    /// recorded before, and before those recorded after, or handing what is returned to [`GpuMesh::discard_swap`];
    /// keeping what is returned until the copies have run.
    ///
    /// # Errors
    /// A mesh of another engine, or one that was uploaded as a whole; another `source`; a target that there is not,
    /// or that is in both lists; one that is to go while poses hold it, by name; more bytes than are free; no memory.
    /// Nothing is recorded then, and nothing changes.
    ///
    /// # Safety
    /// - `cmd` is a primary command buffer in the recording state on the engine's device, outside a render pass and
    ///   without active conditional rendering, on a queue with compute.
    /// - It runs exactly once, after the upload of the mesh and all updates of its crowds and swaps recorded before,
    ///   and before those recorded later; or it never runs, nor does any update recorded later, and
    ///   [`GpuMesh::discard_swap`] is called before anything else of the mesh is recorded.
    /// - What is returned is dropped only when the device no longer uses it. It keeps the buffer of the mesh alive.
    /// - No update of a crowd of the mesh is recorded on another thread meanwhile.
    pub unsafe fn record_swap(
        &self,
        cmd: vk::CommandBuffer,
        mesh: &mut GpuMesh,
        source: &PackedMesh,
        swap: &TargetSwap<'_>,
    ) -> Result<SwapCopies> {
        // SAFETY: the caller's obligations.
        unsafe { self.record_swap_between(cmd, mesh, source, swap, targets_swapped()) }
    }

    /// [`record_swap`](Self::record_swap) with other barriers before and after: lets tests leave them out.
    ///
    /// # Errors
    /// As there.
    ///
    /// # Safety
    /// As there; what barriers do not order is broken.
    #[cfg(feature = "internals")]
    #[doc(hidden)]
    pub unsafe fn record_swap_tampered(
        &self,
        cmd: vk::CommandBuffer,
        mesh: &mut GpuMesh,
        source: &PackedMesh,
        swap: &TargetSwap<'_>,
        keep: [bool; 2],
    ) -> Result<SwapCopies> {
        let [before, after] = targets_swapped();
        let barriers = [before.filter(|_| keep[0]), after.filter(|_| keep[1])];
        // SAFETY: the caller's obligations.
        unsafe { self.record_swap_between(cmd, mesh, source, swap, barriers) }
    }

    /// Record a swap, with these barriers before and after.
    ///
    /// # Safety
    /// As [`record_swap`](Self::record_swap).
    unsafe fn record_swap_between(
        &self,
        cmd: vk::CommandBuffer,
        mesh: &mut GpuMesh,
        source: &PackedMesh,
        swap: &TargetSwap<'_>,
        [before, after]: [Option<Barrier>; 2],
    ) -> Result<SwapCopies> {
        self.check_own(mesh)?;
        let residents = mesh.residents()?;
        check_source(mesh, source)?;
        let group = &mesh.groups[0];
        let mut held = residents.state();
        // Only where nothing fails any more it becomes the state.
        let mut state = held.clone();
        let copied = residents.swap(&mut state, swap)?;
        let (words, runs) = residents.copies(&state, source, &copied);
        let upload = (!runs.is_empty()).then(|| Upload::to(&self.device, &group.deltas, &words, &runs)).transpose()?;
        if let Some(upload) = &upload {
            // SAFETY: the caller's obligations; `SwapCopies` keeps both buffers.
            unsafe {
                before.iter().for_each(|barrier| barriers::record(&self.device.raw, cmd, barrier));
                upload.record(&self.device, cmd);
                after.iter().for_each(|barrier| barriers::record(&self.device.raw, cmd, barrier));
            }
        }
        *held = state;
        Ok(SwapCopies { _staging: upload, copied, bytes: 4 * words.len() as u64, mesh: group.clone() })
    }
}

/// Refuse a mesh that is not the one that was uploaded: it is what deltas are copied from.
fn check_source(uploaded: &GpuMesh, source: &PackedMesh) -> Result<()> {
    // Mostly it is the very same; else it is compared.
    let same = |a: &PackedLayout, b: &PackedLayout| match (&a.blocks, &b.blocks) {
        (Some(one), Some(other)) => Arc::ptr_eq(one, other) || one == other,
        (Some(_) | None, _) => false,
    };
    let (groups, name) = (source.groups(), &source.layout().name);
    if uploaded.groups.len() == groups.len() && uploaded.layouts().zip(groups).all(|(a, b)| same(a, b.layout())) {
        return Ok(());
    }
    let text = format!("targets of mesh '{}' are to come from mesh '{name}', which differs", uploaded.layout().name);
    Err(Error::invalid(text, "hand in the packed mesh that was uploaded, or read it again from its file"))
}
