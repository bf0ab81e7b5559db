//! The steps after the pose, as they are planned: in which order, and what their dispatches use.

use super::steps::{Resource, Use};
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
