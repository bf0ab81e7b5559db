//! The common part of entries of post-morph passes: uploads for a mesh, and targets of crowds.

use crate::arguments::check_command_buffer;
use crate::crowd::State;
use crate::engine::Engine;
use crate::handles::{DmCrowd, DmEngine, DmMesh, Handle};
use crate::memory::{Versioned, check_place, read};
use crate::mesh::Mesh;
use crate::result::{Result, ensure, lock};
use deltamorph::MorphEngine;
use deltamorph::ash::vk::{self, Handle as _};
use std::sync::{Arc, Mutex};

/// Data that a pass reads of a mesh beside its poses, on the device: joints and weights, or triangles.
pub struct Attached<T> {
    on_device: Mutex<T>,
    pub(crate) engine: Arc<Engine>,
}

/// Records an upload with `make`, and writes a handle for its result to `place`, which messages call `what`.
///
/// # Safety
/// The conditions of `make`; `place` can be written.
pub unsafe fn upload<H: Handle<Object = Attached<T>>, T>(
    (engine, cmd, mesh): (DmEngine, vk::CommandBuffer, DmMesh),
    (place, what): (*mut H, &str),
    make: impl FnOnce(&MorphEngine, &Mesh) -> Result<T>,
) -> Result<()> {
    check_place(place, what)?;
    let engine = engine.get()?;
    let mesh = mesh.get()?;
    check_command_buffer(cmd)?;
    let on_device = Mutex::new(make(&engine.morph, &mesh)?);
    // SAFETY: the caller's obligation; it was checked.
    unsafe { place.write(H::insert(Attached { on_device, engine })) };
    Ok(())
}

/// Runs `body` with the object of a handle, which is locked meanwhile.
pub fn with<H: Handle<Object = Attached<T>>, T, R>(handle: H, body: impl FnOnce(&mut T) -> Result<R>) -> Result<R> {
    let object = handle.get()?;
    body(&mut *lock(&object.on_device)?)
}

/// Runs `set` with a crowd that is locked meanwhile, and with `make` of the target; `None` for a null pointer.
///
/// # Safety
/// The conditions of [`read`] unless `target` is null; those of `set`.
pub(crate) unsafe fn set_target<D: Versioned, T>(
    crowd: DmCrowd,
    target: *const D,
    make: impl FnOnce(&D) -> Result<T>,
    set: impl FnOnce(&mut State, &MorphEngine, Option<&T>) -> Result<()>,
) -> Result<()> {
    // SAFETY: the caller's obligation.
    let target = if target.is_null() { None } else { Some(make(&unsafe { read(target) }?)?) };
    let crowd = crowd.get()?;
    let mut state = lock(&crowd.state)?;
    set(&mut state, &crowd.engine.morph, target.as_ref())
}

/// Refuse a null buffer.
pub fn check_buffer(buffer: vk::Buffer, what: &str) -> Result<()> {
    ensure!(!buffer.is_null(), "'{what}' is null; hand in a buffer, or a null pointer for no target");
    Ok(())
}
