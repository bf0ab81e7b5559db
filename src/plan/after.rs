//! The steps after the pose, as they are planned: in which order, and what their dispatches use.

use super::steps::{Resource, Use, Work};
use crate::abi::steps::after_steps;

macro_rules! kinds {
    (() $(
        $(#[doc = $doc:literal])*
        $kind:ident $module:ident::$step:ident $face:tt ($set:ident: $target:ty) {
            $([$($read:ident),*] => $written:ident, $push:ident $members:tt $rows:tt;)*
        }
    )*) => {
        /// A step after the pose, in the order in which they are recorded.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Kind {
            $(#[doc = concat!("The step that `", stringify!($set), "` asks for.")] $kind,)*
        }

        impl Kind {
            /// Every step.
            pub const ALL: [Self; [$(Self::$kind),*].len()] = [$(Self::$kind),*];

            /// What its dispatches use, one after the other.
            pub const fn dispatches(self) -> &'static [&'static [Use]] {
                match self {
                    $(Self::$kind => const {
                        &[$(&[$(Use::read(Resource::$read),)* Use::write(Resource::$written)]),*]
                    },)*
                }
            }

            /// What it writes for the host.
            pub fn output(self) -> Resource {
                match self {
                    $(Self::$kind => *[$(Resource::$written),*].last().expect("a step has a dispatch"),)*
                }
            }
        }
    };
}
after_steps!(kinds());

/// Numbers of kernels from here on are of the steps after the pose: no technique has as many.
const FIRST_KERNEL: u32 = 1 << 31;
/// Dispatches of a step, at most.
const DISPATCHES: u32 = 2;

impl Kind {
    pub(crate) const fn kernel(self, dispatch: usize) -> u32 {
        FIRST_KERNEL + self as u32 * DISPATCHES + dispatch as u32
    }

    /// The number of the step, and which of its dispatches a work is.
    pub(crate) const fn of(work: &Work) -> (u32, usize) {
        let number = work.kernel - FIRST_KERNEL;
        (number / DISPATCHES, (number % DISPATCHES) as usize)
    }

    /// Whether a work is of any step after the pose.
    pub(crate) const fn has(work: &Work) -> bool {
        work.kernel >= FIRST_KERNEL
    }
}
