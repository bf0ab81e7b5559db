//! Checks of arguments and fields of structures: defaults for zeros, reserved fields, command buffers; and entries that
//! need a feature of the library.

use crate::result::{DM_ERROR_UNSUPPORTED, Failure, Result};
use deltamorph::ash::vk::{self, Handle as _};

/// A value, or the default where it is 0.
pub fn or<T: Default + PartialEq>(value: T, default: T) -> T {
    if value == T::default() { default } else { value }
}

/// Reserved fields have to be zero, so that they can get a meaning later.
pub fn check_reserved(structure: &str, reserved: u32) -> Result<()> {
    match reserved {
        0 => Ok(()),
        _ => Err(Failure::invalid(format!("{structure}: 'reserved' is {reserved}; set it to 0"))),
    }
}

/// Refuse a null command buffer.
pub fn check_command_buffer(cmd: vk::CommandBuffer) -> Result<()> {
    match cmd.is_null() {
        true => Err(Failure::invalid("'cmd' is null; hand in a command buffer that is being recorded")),
        false => Ok(()),
    }
}

/// Returns from an entry whose feature the library was built without. A function that returned the failure would not
/// do: compilers keep the code that follows if they cannot see that it always fails.
macro_rules! built {
    ($feature:literal, $what:literal) => {
        if !cfg!(feature = $feature) {
            return Err(crate::arguments::not_built($feature, $what));
        }
    };
}

pub(crate) use built;

/// The failure of an entry that was built without a feature.
#[cold]
pub fn not_built(feature: &str, what: &str) -> Failure {
    let message = format!("the library was built without {what}; build it with the feature '{feature}'");
    Failure { code: DM_ERROR_UNSUPPORTED, message }
}

#[cfg(test)]
mod tests {
    use crate::handles::{DmClip, DmCrowd, DmEngine, DmSkin, DmSurface, DmWeightBounds};
    use crate::result::{DM_ERROR_HANDLE, DM_ERROR_INVALID, DM_ERROR_UNSUPPORTED, DmResult, dm_last_error};
    use crate::structs::DmSampleDesc;
    use crate::{after, bounds, clip, crowd, engine, memory::Versioned, skin};
    use std::ffi::CStr;
    use std::ptr::{null, null_mut};

    fn check(feature: &str, is_built: bool, otherwise: DmResult, code: DmResult) {
        // SAFETY: a string that is valid until the next failure on this thread.
        let said = unsafe { CStr::from_ptr(dm_last_error()) }.to_str().unwrap();
        assert_eq!(code, if is_built { otherwise } else { DM_ERROR_UNSUPPORTED }, "{said}");
        assert_eq!(said.contains(&format!("build it with the feature '{feature}'")), !is_built, "{said}");
    }

    #[test]
    fn entries_whose_feature_is_not_there_say_so() {
        let bits = 0;
        let crowd = DmCrowd { bits };
        let sample = DmSampleDesc { struct_size: 4, ..DmSampleDesc::zeroed() };
        let mut clip = DmClip { bits };
        let after = |code| check("after", cfg!(feature = "after"), DM_ERROR_HANDLE, code);
        let level = |code| check("level", cfg!(feature = "level"), DM_ERROR_HANDLE, code);
        let memory = |code| check("memory", cfg!(feature = "memory"), DM_ERROR_INVALID, code);
        let of_sample = |code| check("sample", cfg!(feature = "sample"), DM_ERROR_INVALID, code);
        // SAFETY: null pointers and handles are allowed, or refused; the structure is refused.
        unsafe {
            after(skin::dm_crowd_set_skin_target(crowd, 0, DmSkin { bits }, null()));
            after(after::dm_crowd_set_normals_target(crowd, 0, DmSurface { bits }, null()));
            after(skin::dm_crowd_set_joints(crowd, 0, 0));
            after(bounds::dm_weight_bounds_of(DmWeightBounds { bits }, null(), 0, 0.0, null_mut()));
            level(crowd::dm_crowd_set_level(crowd, 0, 1.0));
            memory(engine::dm_engine_memory(DmEngine { bits }, null_mut()));
            of_sample(clip::dm_clip_sample_head(&raw const sample, 1, 30.0, &raw mut clip));
        }
    }
}
