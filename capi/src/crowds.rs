//! Sets: crowds of several meshes that take one weight vector. A set refers to crowds, which stay the caller's: they
//! are recorded, drawn and skinned by their own handles.

use crate::crowd::{Crowd, lock_all};
use crate::handles::{DmCrowd, DmCrowds, Handle};
use crate::memory::{check_place, list, slice, text};
use crate::result::{DmResult, Failure, Result, enter, lock};
use deltamorph::WeightMap;
use std::ffi::{CString, c_char};
use std::sync::{Arc, Mutex};

/// The object of a `DmCrowds`.
pub struct Crowds {
    members: Vec<DmCrowd>,
    bound: Mutex<Bound>,
}

/// The map of a set's weights, and their names as C has them.
struct Bound {
    map: WeightMap,
    names: Vec<CString>,
}

fn objects(members: &[DmCrowd]) -> Result<Vec<Arc<Crowd>>> {
    members.iter().map(|crowd| crowd.get()).collect()
}

/// The names of the targets of each crowd.
fn target_names(members: &[DmCrowd]) -> Result<Vec<Vec<String>>> {
    let objects = objects(members)?;
    let mut states = lock_all(members, &objects)?;
    let names = |crowd: &deltamorph::Crowd| crowd.layout().targets.iter().map(|target| target.name.clone()).collect();
    states.iter_mut().map(|state| Ok(names(state.weighted()?))).collect()
}

impl From<WeightMap> for Bound {
    fn from(map: WeightMap) -> Self {
        let name = |name: &String| CString::new(name.replace('\0', "\u{fffd}")).unwrap_or_default();
        Self { names: map.names().iter().map(name).collect(), map }
    }
}

/// Make a set of `count` crowds whose weights are set by one vector: each weight goes, by its name, to the targets of
/// that name in every mesh. Instance i of the set is instance i of each crowd. At first the weights are those of all
/// targets: each name once, in the order of the crowds and of their targets.
///
/// The crowds stay the caller's: `dm_record_updates` records their updates with shared barriers, and each is cut,
/// hidden, skinned and destroyed by its own handle. After one is destroyed, the set can only be destroyed.
///
/// Errors: DM_ERROR_INVALID for an empty list, a crowd that is named twice, or one that plays clips.
///
/// # Safety
/// There are `count` crowds; `set` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowds_create(crowds: *const DmCrowd, count: u32, set: *mut DmCrowds) -> DmResult {
    enter("dm_crowds_create", || {
        check_place(set, "set")?;
        // SAFETY: the caller's obligation.
        let members = unsafe { slice(crowds, count as usize, "crowds") }?.to_vec();
        if members.is_empty() {
            return Err(Failure::invalid("a set of no crowd; name one or more"));
        }
        let bound = Mutex::new(WeightMap::new(target_names(&members)?).into());
        // SAFETY: the caller's obligation; it was checked.
        unsafe { set.write(DmCrowds::insert(Crowds { members, bound })?) };
        Ok(())
    })
}

/// Set the names, and so the order, of the weights from now on: those of a clip or of a tracker. Targets that are not
/// among them keep the weights that were requested last.
///
/// Errors: DM_ERROR_INVALID for a name that no mesh has, or that comes twice; DM_ERROR_HANDLE if a crowd was destroyed.
/// Nothing changes then.
///
/// # Safety
/// There are `count` names, UTF-8 strings.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowds_bind(set: DmCrowds, names: *const *const c_char, count: u32) -> DmResult {
    enter("dm_crowds_bind", || {
        // SAFETY: the caller's obligations.
        let names = unsafe { slice(names, count as usize, "names") }?.iter();
        // SAFETY: as above.
        let names = names.map(|name| Ok(unsafe { text(*name, "name of a weight") }?.to_owned()));
        let (names, set) = (names.collect::<Result<_>>()?, set.get()?);
        let mut map = WeightMap::new(target_names(&set.members)?);
        map.bind(names)?;
        *lock(&set.bound)? = map.into();
        Ok(())
    })
}

/// List the names of a set's weights, in their order: UTF-8, valid until the set is bound again, or destroyed.
///
/// With `names` null, `count` becomes their number. Otherwise `count` is the room in `names`.
///
/// Errors: DM_ERROR_INVALID for too little room.
///
/// # Safety
/// `count` can be read and written; `names` is null or has room for that many.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowds_names(set: DmCrowds, count: *mut u32, names: *mut *const c_char) -> DmResult {
    enter("dm_crowds_names", || {
        let set = set.get()?;
        let found: Vec<*const c_char> = lock(&set.bound)?.names.iter().map(|name| name.as_ptr()).collect();
        // SAFETY: the caller's obligations.
        unsafe { list(count, names, &found, "names") }
    })
}

/// Request these weights of an instance in all crowds, one for each name of the set, from the next recorded updates on.
///
/// Errors: DM_ERROR_INVALID for a wrong number of weights; those of `dm_crowd_set_weights`; DM_ERROR_HANDLE if a crowd
/// was destroyed. Nothing changes then, in any crowd.
///
/// # Safety
/// There are `count` weights.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowds_set_weights(
    set: DmCrowds,
    instance: u32,
    weights: *const f32,
    count: u32,
) -> DmResult {
    enter("dm_crowds_set_weights", || {
        // SAFETY: the caller's obligation.
        let weights = unsafe { slice(weights, count as usize, "weights") }?;
        let set = set.get()?;
        let bound = lock(&set.bound)?;
        let objects = objects(&set.members)?;
        let mut states = lock_all(&set.members, &objects)?;
        let mut crowds = states.iter_mut().map(|state| state.weighted()).collect::<Result<Vec<_>>>()?;
        let before = crowds.iter().map(|crowd| Ok(crowd.weights(instance)?.to_vec())).collect::<Result<Vec<_>>>()?;
        for (at, before_this) in before.iter().enumerate() {
            let mut wanted = before_this.clone();
            bound.map.apply(at, weights, &mut wanted)?;
            if let Err(error) = crowds[at].set_weights(instance, &wanted) {
                // They returned these weights, so they accept them.
                crowds
                    .iter_mut()
                    .zip(&before)
                    .take(at)
                    .try_for_each(|(crowd, was)| crowd.set_weights(instance, was))?;
                return Err(error.into());
            }
        }
        Ok(())
    })
}

/// Destroy a set. Its crowds stay.
#[unsafe(no_mangle)]
pub extern "C" fn dm_crowds_destroy(set: DmCrowds) -> DmResult {
    enter("dm_crowds_destroy", || set.destroy(|_| Ok(())))
}
