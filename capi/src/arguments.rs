//! Checks of arguments and fields of structures: defaults for zeros, reserved fields, command buffers.

use crate::result::{Failure, Result};
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
