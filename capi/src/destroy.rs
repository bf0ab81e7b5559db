//! The end of an engine, which objects made with it may still use.

use crate::engine::Engine;
use crate::handles::{DmCrowd, DmEngine, DmGpuMesh, DmReadback, DmSkin, DmSurface, Handle};
use crate::result::{DmResult, Failure, enter};
use std::sync::Arc;

/// Destroy an engine. All objects made with it have to be destroyed first: DmGpuMesh, DmCrowd, DmReadback, DmSkin,
/// DmSurface. The device may be destroyed afterwards.
///
/// Errors: DM_ERROR_INVALID while such objects are alive, with their kinds and numbers; nothing changes then.
#[unsafe(no_mangle)]
pub extern "C" fn dm_engine_destroy(engine: DmEngine) -> DmResult {
    enter("dm_engine_destroy", || {
        engine.destroy(|engine| match Arc::strong_count(engine) {
            1 => Ok(()),
            _ => Err(Failure::invalid(format!("the engine is used by {}", users(engine)))),
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
    match alive.is_empty() {
        true => "a call on another thread; destroy it when that has returned".to_owned(),
        false => format!("{}; destroy these first", alive.join(", ")),
    }
}
