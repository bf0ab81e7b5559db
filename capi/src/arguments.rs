//! Checks of arguments and fields of structures: defaults for zeros, command buffers.

use crate::result::{Result, ensure};
use deltamorph::ash::vk::{self, Handle as _};

/// A value, or the default where it is 0.
pub fn or<T: Default + PartialEq>(value: T, default: T) -> T {
    if value == T::default() { default } else { value }
}

/// Refuse a null command buffer.
pub fn check_command_buffer(cmd: vk::CommandBuffer) -> Result<()> {
    ensure!(!cmd.is_null(), "'cmd' is null; hand in a command buffer that is being recorded");
    Ok(())
}
