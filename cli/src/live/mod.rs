//! Weights that arrive over UDP while they are made: `view --listen`, and `play --send`, which sends those of a clip.

#[cfg(feature = "viewer")]
mod listen;
#[cfg_attr(not(feature = "viewer"), allow(dead_code))] // reading
mod packets;
#[cfg(feature = "viewer")]
mod record;
mod send;

#[cfg(feature = "viewer")]
pub use listen::Live;
#[cfg(feature = "viewer")]
pub use record::Recorder;

pub use send::run as send;

/// Where programs that receive VMC listen.
pub const ADDRESS: &str = "127.0.0.1:39539";
