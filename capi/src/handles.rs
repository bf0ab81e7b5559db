//! Handles: 64 bits that name an object by kind, generation and index. Null, foreign and destroyed ones are refused.

use crate::kinds::KINDS;
use crate::result::{Failure, Result};
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

/// A mesh in memory, packed. All zero: none.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DmMesh {
    /// Kind, generation and index.
    pub bits: u64,
}

/// The engine on a device of the host's. All zero: none.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DmEngine {
    /// Kind, generation and index.
    pub bits: u64,
}

/// A mesh on the device. All zero: none.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DmGpuMesh {
    /// Kind, generation and index.
    pub bits: u64,
}

/// Instances of a mesh on the device, whose weights are set, or that play clips. All zero: none.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DmCrowd {
    /// Kind, generation and index.
    pub bits: u64,
}

/// A clip of weights with names of targets. All zero: none.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DmClip {
    /// Kind, generation and index.
    pub bits: u64,
}

/// A clip whose columns are bound to targets of a mesh. All zero: none.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DmBoundClip {
    /// Kind, generation and index.
    pub bits: u64,
}

/// Host memory that poses are copied to and decoded from. All zero: none.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DmReadback {
    /// Kind, generation and index.
    pub bits: u64,
}

/// Joints and weights of a mesh's vertices, on the device. All zero: none.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DmSkin {
    /// Kind, generation and index.
    pub bits: u64,
}

/// The triangles around each vertex of a mesh, on the device: for normals of the morphed surface. All zero: none.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DmSurface {
    /// Kind, generation and index.
    pub bits: u64,
}

/// Computes bounds of poses from their weights. All zero: none.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DmWeightBounds {
    /// Kind, generation and index.
    pub bits: u64,
}

/// A handle as functions receive it.
pub trait Handle: Copy {
    /// The type of the object.
    type Object: 'static;

    /// All objects of the kind.
    fn registry() -> &'static Registry<Self::Object>;

    /// The handle with these bits.
    fn of(bits: u64) -> Self;

    /// Its bits.
    fn bits(self) -> u64;

    /// A handle for `object`.
    fn insert(object: Self::Object) -> Result<Self> {
        Self::registry().insert(object).map(Self::of)
    }

    /// The object, which lives at least until the reference is dropped, even if another thread destroys it meanwhile.
    fn get(self) -> Result<Arc<Self::Object>> {
        Self::registry().get(self.bits())
    }

    /// Makes the handle name nothing, unless `check` refuses. `check` sees the only reference to the object apart from
    /// those of calls on other threads, and of objects made from it.
    fn destroy(self, check: impl FnOnce(&Arc<Self::Object>) -> Result<()>) -> Result<()> {
        // Dropped here, after the registry is unlocked.
        Self::registry().remove(self.bits(), check).map(drop)
    }
}

// A handle, from its highest bit:
//
//     63   56 55          32 31          0
//     [ kind ][ generation ][   index    ]
const KIND_SHIFT: u32 = 56;
const GENERATION_SHIFT: u32 = 32;
const GENERATION_MAX: u32 = (1 << (KIND_SHIFT - GENERATION_SHIFT)) - 1;

/// The index in `bits`, if they are of this kind.
#[inline(never)]
fn index(wanted_kind: u8, bits: u64) -> Result<usize> {
    let kind = (bits >> KIND_SHIFT) as usize;
    let wanted = KINDS[usize::from(wanted_kind)];
    if kind == usize::from(wanted_kind) {
        return Ok(bits as u32 as usize);
    }
    Err(Failure::handle(match KINDS.get(kind) {
        _ if bits == 0 => format!("a null handle in place of {wanted}; create one, and check what that returned"),
        Some(found) if kind > 0 => format!("the handle of {found} in place of {wanted}; hand in {wanted}"),
        Some(_) | None => format!("{bits:#x} is no handle; hand in {wanted} that this library created"),
    }))
}

#[cold]
#[inline(never)]
fn refused(kind: u8, bits: u64) -> Failure {
    let wanted = KINDS[usize::from(kind)];
    Failure::handle(format!("{wanted} {bits:#x} that was destroyed, or never created; use one that is alive"))
}

/// The objects of one kind. A slot is used again with another generation, so that a handle of its former object is
/// recognised; a slot whose generations are used up stays empty.
pub struct Registry<T> {
    kind: u8,
    places: RwLock<Places<T>>,
}

struct Places<T> {
    all: Vec<Place<T>>,
    free: Vec<u32>,
}

struct Place<T> {
    generation: u32,
    object: Option<Arc<T>>,
}

impl<T> Registry<T> {
    /// An empty registry for the kind with this number.
    pub const fn new(kind: u8) -> Self {
        Self { kind, places: RwLock::new(Places { all: vec![], free: vec![] }) }
    }

    // No code panics halfway through a change of the slots, so a poisoned lock is still good.
    fn read(&self) -> RwLockReadGuard<'_, Places<T>> {
        self.places.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn write(&self) -> RwLockWriteGuard<'_, Places<T>> {
        self.places.write().unwrap_or_else(PoisonError::into_inner)
    }

    fn insert(&self, object: T) -> Result<u64> {
        let object = Some(Arc::new(object));
        let mut places = self.write();
        let index = match places.free.pop() {
            Some(index) => index,
            None => {
                let index = u32::try_from(places.all.len()).map_err(|_| Failure::handle("no handle is left"))?;
                places.all.push(Place { generation: 0, object: None });
                index
            }
        };
        let place = &mut places.all[index as usize];
        place.generation += 1;
        place.object = object;
        let generation = u64::from(place.generation) << GENERATION_SHIFT;
        Ok(u64::from(self.kind) << KIND_SHIFT | generation | u64::from(index))
    }

    fn get(&self, bits: u64) -> Result<Arc<T>> {
        let index = index(self.kind, bits)?;
        let places = self.read();
        let place = places.all.get(index).filter(|place| place.is(bits));
        place.and_then(|place| place.object.clone()).ok_or_else(|| refused(self.kind, bits))
    }

    /// The number of live objects for which `belongs` holds.
    pub fn count(&self, belongs: impl Fn(&T) -> bool) -> usize {
        self.read().all.iter().filter_map(|place| place.object.as_deref()).filter(|object| belongs(object)).count()
    }

    fn remove(&self, bits: u64, check: impl FnOnce(&Arc<T>) -> Result<()>) -> Result<Arc<T>> {
        let index = index(self.kind, bits)?;
        let refused = || refused(self.kind, bits);
        let mut places = self.write();
        let place = places.all.get_mut(index).filter(|place| place.is(bits)).ok_or_else(refused)?;
        check(place.object.as_ref().ok_or_else(refused)?)?;
        let object = place.object.take().ok_or_else(refused)?;
        if place.generation < GENERATION_MAX {
            places.free.push(index as u32);
        }
        Ok(object)
    }
}

impl<T> Place<T> {
    fn is(&self, bits: u64) -> bool {
        (bits >> GENERATION_SHIFT) as u32 & GENERATION_MAX == self.generation
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::result::DM_ERROR_HANDLE;

    fn refused<T>(result: Result<T>) -> String {
        let Err(failure) = result else { panic!("it was taken") };
        assert_eq!(failure.code, DM_ERROR_HANDLE);
        failure.message
    }

    #[test]
    fn what_is_refused_stays_and_a_place_without_generations_is_left() {
        let registry = Registry::new(1);
        let first = registry.insert(1).unwrap();
        refused(registry.remove(first, |_| Err(Failure::handle("in use"))));
        assert_eq!(*registry.get(first).unwrap(), 1);
        registry.write().all[0].generation = GENERATION_MAX;
        let generations = u64::from(GENERATION_MAX) << GENERATION_SHIFT;
        let last = first | generations;
        registry.remove(last, |_| Ok(())).unwrap();
        assert_eq!(registry.insert(2).unwrap() as u32, 1);
    }
}
