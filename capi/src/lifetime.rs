//! The staging memory of objects made with an engine, and the end of the engine.

use crate::engine::Engine;
use crate::handles::{DmCrowd, DmEngine, DmGpuMesh, DmReadback, DmSkin, DmSurface, Handle, Kind, is_kind};
use crate::result::{DmResult, ensure, enter, lock};
use crate::{attached, crowd};
use std::sync::Arc;

/// Free the staging memory of an upload. `handle` is the `bits` of what was uploaded: a DmGpuMesh, DmSkin or DmSurface,
/// or a DmCrowd that plays clips.
///
/// Errors: DM_ERROR_INVALID for a crowd that plays no clips.
///
/// # Safety
/// The upload has run, or never will.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_release_staging(handle: u64) -> DmResult {
    enter("dm_release_staging", || {
        if is_kind(handle, Kind::DmCrowd) {
            crowd::with(DmCrowd::of(handle), |state| {
                state.animated()?.release_staging();
                Ok(())
            })
        } else if is_kind(handle, Kind::DmSkin) {
            attached::with(DmSkin::of(handle), |skin| {
                skin.release_staging();
                Ok(())
            })
        } else if is_kind(handle, Kind::DmSurface) {
            attached::with(DmSurface::of(handle), |surface| {
                surface.release_staging();
                Ok(())
            })
        } else {
            lock(&DmGpuMesh::of(handle).get()?.mesh)?.release_staging();
            Ok(())
        }
    })
}

/// Destroy an engine. All objects made with it have to be destroyed first: DmGpuMesh, DmCrowd, DmReadback, DmSkin,
/// DmSurface. The device may be destroyed afterwards.
///
/// Errors: DM_ERROR_INVALID while such objects are alive, with their kinds and numbers; nothing changes then.
#[unsafe(no_mangle)]
pub extern "C" fn dm_engine_destroy(engine: DmEngine) -> DmResult {
    enter("dm_engine_destroy", || {
        engine.destroy(|engine| {
            ensure!(Arc::strong_count(engine) == 1, "the engine is used by {}", users(engine));
            Ok(())
        })
    })
}

/// The kinds and numbers of live objects that use an engine, and the remedy.
fn users(engine: &Arc<Engine>) -> String {
    fn count<H: Handle>(engine: &Arc<Engine>, of: impl Fn(&H::Object) -> &Arc<Engine>) -> usize {
        H::registry().count(|object| Arc::ptr_eq(of(object), engine))
    }
    let counts = [
        ("DmGpuMesh", count::<DmGpuMesh>(engine, |mesh| &mesh.engine)),
        ("DmCrowd", count::<DmCrowd>(engine, |crowd| &crowd.engine)),
        ("DmReadback", count::<DmReadback>(engine, |readback| &readback.engine)),
        ("DmSkin", count::<DmSkin>(engine, |skin| &skin.engine)),
        ("DmSurface", count::<DmSurface>(engine, |surface| &surface.engine)),
    ];
    let alive: Vec<String> = counts.iter().filter(|(_, n)| *n > 0).map(|(kind, n)| format!("{n} {kind}")).collect();
    if alive.is_empty() {
        "a call on another thread; destroy it when that has returned".to_owned()
    } else {
        format!("{}; destroy these first", alive.join(", "))
    }
}
