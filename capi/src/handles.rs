//! Handles: 64 bits that name an object by kind and number. Null, foreign and destroyed ones are refused.

use crate::result::{Failure, Result};
use std::collections::BTreeMap;
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

/// A mesh in memory, packed. All zero: none.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmMesh {
    /// Kind and number.
    pub bits: u64,
}

/// The engine on a device of the host's. All zero: none.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmEngine {
    /// Kind and number.
    pub bits: u64,
}

/// A mesh on the device. All zero: none.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmGpuMesh {
    /// Kind and number.
    pub bits: u64,
}

/// Instances of a mesh on the device, whose weights are set, or that play clips. All zero: none.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmCrowd {
    /// Kind and number.
    pub bits: u64,
}

/// A clip of weights with names of targets. All zero: none.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmClip {
    /// Kind and number.
    pub bits: u64,
}

/// A clip whose columns are bound to targets of a mesh. All zero: none.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmBoundClip {
    /// Kind and number.
    pub bits: u64,
}

/// Host memory that poses are copied to and decoded from. All zero: none.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmReadback {
    /// Kind and number.
    pub bits: u64,
}

/// Joints and weights of a mesh's vertices, on the device. All zero: none.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmSkin {
    /// Kind and number.
    pub bits: u64,
}

/// The triangles around each vertex of a mesh, on the device: for normals of the morphed surface. All zero: none.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmSurface {
    /// Kind and number.
    pub bits: u64,
}

/// Computes bounds of poses from their weights. All zero: none.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DmWeightBounds {
    /// Kind and number.
    pub bits: u64,
}

macro_rules! kinds {
    ($($handle:ident $name:literal;)*) => {
        /// The name of each kind in messages, by number.
        pub const KINDS: &[&str] = &["", $($name),*];

        /// The kinds of objects, with their numbers.
        pub enum Kind {
            /// No object.
            None,
            $(
                #[doc = concat!("That of `", stringify!($handle), "`.")]
                $handle,
            )*
        }
    };
}

kinds! {
    DmMesh "a mesh";
    DmEngine "an engine";
    DmGpuMesh "a mesh on the device";
    DmCrowd "a crowd";
    DmClip "a clip";
    DmBoundClip "a bound clip";
    DmReadback "a read-back";
    DmSkin "a skin";
    DmSurface "a surface";
    DmWeightBounds "bounds from weights";
}

/// Makes a type a handle for objects of another type.
macro_rules! handle {
    ($handle:ident for $object:ty) => {
        impl $crate::handles::Handle for $handle {
            type Object = $object;

            fn registry() -> &'static $crate::handles::Registry<$object> {
                use $crate::handles::{Kind, Registry};
                static REGISTRY: Registry<$object> = Registry::new(Kind::$handle as u8);
                &REGISTRY
            }

            fn of(bits: u64) -> Self {
                Self { bits }
            }

            fn bits(self) -> u64 {
                self.bits
            }
        }
    };
}
pub(crate) use handle;

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
    fn insert(object: Self::Object) -> Self {
        Self::of(Self::registry().insert(object))
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
//     63   56 55                    0
//     [ kind ][ number, from 1 on   ]
const KIND_SHIFT: u32 = 56;

/// Whether `bits` are of this kind.
pub fn is_kind(bits: u64, kind: Kind) -> bool {
    bits >> KIND_SHIFT == kind as u64
}

/// Checks that `bits` are of this kind.
#[inline(never)]
fn check(wanted_kind: u8, bits: u64) -> Result<()> {
    let kind = (bits >> KIND_SHIFT) as usize;
    let wanted = KINDS[usize::from(wanted_kind)];
    if kind == usize::from(wanted_kind) {
        return Ok(());
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

/// The objects of one kind, by the bits of their handles. No number is used twice: a process that makes a million
/// objects a second has enough for two thousand years.
pub struct Registry<T> {
    kind: u8,
    objects: RwLock<Objects<T>>,
}

struct Objects<T> {
    alive: BTreeMap<u64, Arc<T>>,
    /// The bits of the last handle.
    last: u64,
}

impl<T> Registry<T> {
    /// An empty registry for the kind with this number.
    pub const fn new(kind: u8) -> Self {
        let last = (kind as u64) << KIND_SHIFT;
        Self { kind, objects: RwLock::new(Objects { alive: BTreeMap::new(), last }) }
    }

    // No code panics halfway through a change of the objects, so a poisoned lock is still good.
    fn read(&self) -> RwLockReadGuard<'_, Objects<T>> {
        self.objects.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn write(&self) -> RwLockWriteGuard<'_, Objects<T>> {
        self.objects.write().unwrap_or_else(PoisonError::into_inner)
    }

    fn insert(&self, object: T) -> u64 {
        let object = Arc::new(object);
        let mut objects = self.write();
        objects.last += 1;
        let bits = objects.last;
        objects.alive.insert(bits, object);
        bits
    }

    fn get(&self, bits: u64) -> Result<Arc<T>> {
        check(self.kind, bits)?;
        self.read().alive.get(&bits).cloned().ok_or_else(|| refused(self.kind, bits))
    }

    /// The number of live objects for which `belongs` holds.
    pub fn count(&self, belongs: impl Fn(&T) -> bool) -> usize {
        self.read().alive.values().filter(|object| belongs(object)).count()
    }

    fn remove(&self, bits: u64, allows: impl FnOnce(&Arc<T>) -> Result<()>) -> Result<Arc<T>> {
        check(self.kind, bits)?;
        let mut objects = self.write();
        let refused = || refused(self.kind, bits);
        allows(objects.alive.get(&bits).ok_or_else(refused)?)?;
        objects.alive.remove(&bits).ok_or_else(refused)
    }
}
