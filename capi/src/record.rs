//! Updates into the host's command buffer, and their tickets.

use crate::arguments::check_command_buffer;
use crate::crowd::{Crowd, lock_all};
use crate::handles::{DmCrowd, Handle};
use crate::memory::{Place, Versioned, slice};
use crate::result::{DmResult, Result, ensure, enter, lock};
use crate::structs::{DmTicket, DmUpdate};
use deltamorph::Update;
use deltamorph::ash::vk::{self, Handle as _};
use std::sync::Arc;

/// The result of an update in C's terms.
fn told(crowd: DmCrowd, number: u64, update: &Update) -> DmUpdate {
    let stats = &update.stats;
    DmUpdate {
        bound: stats.bound,
        ticket: DmTicket { crowd: crowd.bits(), number },
        coefficients: stats.coefficients as u64,
        passes: stats.passes as u64,
        rebuilt: stats.rebuilt as u64,
        dirty_blocks: stats.dirty_blocks as u64,
        rebuilt_blocks: stats.rebuilt_blocks as u64,
        bytes_moved: stats.bytes_moved,
        bytes_floor: stats.bytes_floor,
        timestamps: update.timestamps,
        ..DmUpdate::zeroed()
    }
}

/// Record the updates of all instances of one or more crowds of an engine to the requested weights, or to the time set.
/// They share their barriers.
///
/// This records nothing if no weight changed; otherwise the passes of the plan with the barriers that they need. First
/// stages: those of the crowds' consumers (reads of earlier poses) and the paths' own; last: the consumers', by default
/// VERTEX_INPUT with VERTEX_ATTRIBUTE_READ and VERTEX_SHADER with SHADER_READ. It replaces the bound compute
/// pipeline, its set 0 and push constants; on `DM_PATH_FEEDBACK` the bound graphics pipeline, vertex bindings from 0
/// on, push constants and transform-feedback binding 0.
///
/// Errors: DM_ERROR_INVALID for an empty list, a crowd that is named twice, crowds of several engines, or for queues of
/// several families. Nothing is recorded after an error.
///
/// # Safety
/// - `cmd` is a primary command buffer in the recording state on the engine's device, outside a render pass and without
///   active conditional rendering, on a queue of DmCrowdDesc::queue_family, or else with graphics and compute. No other
///   thread uses it meanwhile.
/// - It runs exactly once, after the upload of the meshes and all earlier updates of the crowds, and before later ones;
///   or it never runs, and `dm_crowd_discard` is called with the ticket of each crowd before any later update of that
///   crowd is submitted. Updates recorded after it are discarded with it, and never run either.
/// - With this one, at most DmCrowdDesc::frames_in_flight updates of each crowd are recorded and not yet finished.
/// - After `DM_ERROR_PANIC` the command buffer does not run.
/// - There are `count` crowds; `updates` is null or an array of as many structures that can be written, each with its
///   size.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_record_update(
    cmd: vk::CommandBuffer,
    count: u32,
    crowds: *const DmCrowd,
    updates: *mut DmUpdate,
) -> DmResult {
    enter("dm_record_update", || {
        // SAFETY: the caller's obligation.
        let handles = unsafe { slice(crowds, count as usize, "crowds") }?;
        // SAFETY: as above.
        let mut places = unsafe { places(updates, count) }?;
        let objects = handles.iter().map(|crowd| crowd.get()).collect::<Result<Vec<Arc<Crowd>>>>()?;
        check_command_buffer(cmd)?;
        ensure!(count > 0, "an update of an empty list of crowds; pass at least one");
        let engine = &objects[0].engine;
        let one = objects.iter().all(|object| Arc::ptr_eq(&object.engine, engine));
        ensure!(one, "crowds of several engines; record the updates of each engine by themselves");
        let mut states = lock_all(handles, &objects)?;
        let mut all: Vec<_> = states.iter_mut().map(|state| &mut state.crowd).collect();
        // SAFETY: the caller's obligations.
        let recorded = unsafe { engine.morph.record_updates(cmd, &mut all) }?;
        places.resize_with(recorded.len(), || None);
        for (((recorded, place), state), handle) in recorded.iter().zip(places).zip(&mut states).zip(handles) {
            let number = state.tickets.push(recorded.ticket);
            if let Some(place) = place {
                place.write(told(*handle, number, recorded));
            }
        }
        Ok(())
    })
}

/// Output pointers for `count` updates; empty if `updates` is null.
///
/// # Safety
/// The conditions of [`dm_record_update`].
unsafe fn places(updates: *mut DmUpdate, count: u32) -> Result<Vec<Option<Place<DmUpdate>>>> {
    let mut all = vec![];
    let mut next = updates;
    while !updates.is_null() && all.len() < count as usize {
        // SAFETY: the caller's obligation; there is a structure at `next`, and its size is right once `Place` took it.
        unsafe {
            let place = Place::new(next)?;
            next = place.next();
            all.push(Some(place));
        }
    }
    Ok(all)
}

/// Have the next update of a crowd that is recorded write timestamps into queries of the application: query `first`
/// when the commands before the update have finished, the following ones after each of its steps, at BOTTOM_OF_PIPE.
/// DmUpdate::timestamps says how many. Recording fails if `count` is too small; the setting is used up either way.
///
/// # Safety
/// - Queries `first` to `first` + `count` are of a pool of timestamps on the engine's device, which lives until the
///   device has finished. They are reset before the update runs, and in no other use until then.
/// - The queue of the update has timestamps (`timestampValidBits` of its family is not 0).
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_set_queries(crowd: DmCrowd, pool: vk::QueryPool, first: u32, count: u32) -> DmResult {
    enter("dm_crowd_set_queries", || {
        ensure!(!pool.is_null(), "'pool' is null; hand in a query pool");
        let object = crowd.get()?;
        // SAFETY: the caller's obligations.
        unsafe { lock(&object.state)?.crowd.set_queries(pool, first, count) };
        Ok(())
    })
}

/// Discard the update of a ticket and all later ones of the crowd, which will never run: the contents of the poses that
/// they would have written are unknown, and the next update writes them again. Discarding an update twice changes
/// nothing.
///
/// Errors: DM_ERROR_INVALID for a ticket of another crowd, or of an update before the last 1024.
///
/// # Safety
/// Neither the update nor any later one of the crowd runs.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dm_crowd_discard(crowd: DmCrowd, ticket: DmTicket) -> DmResult {
    enter("dm_crowd_discard", || {
        ensure!(ticket.crowd == crowd.bits(), "the ticket of another crowd; hand in the crowd that was updated");
        let object = crowd.get()?;
        let mut state = lock(&object.state)?;
        let ticket = state.tickets.find(ticket.number)?;
        Ok(state.crowd.discard(ticket)?)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltamorph::{CrowdDesc, UpdateDesc};

    #[test]
    fn zeros_describe_the_crowd_that_rust_has_by_default() {
        use crate::structs::DmCrowdDesc;
        use deltamorph::PoseFormat;
        let desc = DmCrowdDesc::zeroed().crowd(PoseFormat::Float32).unwrap();
        assert_eq!(desc, CrowdDesc::new(UpdateDesc::blocks()));
    }
}
