//! Chained setters of descriptions. Descriptions are `#[non_exhaustive]`, so that fields can be added: outside the
//! crate they are made by `new` or `default` and then changed.

/// Writes a setter for each field listed. Also for the packages of this repository; no part of the API.
#[doc(hidden)]
#[macro_export]
macro_rules! setters {
    ($owner:ident $(<$life:lifetime>)? { $($field:ident: $type:ty),+ $(,)? }) => {
        impl $(<$life>)? $owner $(<$life>)? {
            $(
                #[doc = concat!("Set [`", stringify!($field), "`](field@Self::", stringify!($field), ").")]
                #[must_use]
                pub fn $field(mut self, $field: $type) -> Self {
                    self.$field = $field;
                    self
                }
            )+
        }
    };
}

pub(crate) use setters;
