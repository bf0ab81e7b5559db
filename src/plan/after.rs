//! Steps after the pose, as the planner sees them: their order and the memory of their dispatches.

use super::steps::{Resource, Use};
use crate::abi::steps::after_steps;

macro_rules! kinds {
    (() $(
        $(#[doc = $doc:literal])*
        $kind:ident $module:ident::$step:ident $face:tt ($set:ident: $target:ty) {
            [$($read:ident),*] => $written:ident, $push:ident $members:tt $rows:tt
        }
    )*) => {
        /// Steps after the pose, in recording order.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Kind {
            $(#[doc = concat!("The step that `", stringify!($set), "` asks for.")] $kind,)*
        }

        impl Kind {
            /// Every step.
            pub const ALL: [Self; [$(Self::$kind),*].len()] = [$(Self::$kind),*];

            /// Its name.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$kind => stringify!($module),)*
                }
            }

            /// The memory uses of its dispatch.
            pub const fn uses(self) -> &'static [Use] {
                match self {
                    $(Self::$kind => const { &[$(Use::read(Resource::$read),)* Use::write(Resource::$written)] },)*
                }
            }

            /// The output that the host reads.
            pub fn output(self) -> Resource {
                match self {
                    $(Self::$kind => Resource::$written,)*
                }
            }
        }
    };
}
after_steps!(kinds());
