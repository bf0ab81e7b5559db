//! The one error type of the crate: every variant names the thing, the value and the remedy.

use ash::vk;
use std::fmt::{Display, Formatter, Write};
use std::io;
use std::path::{Path, PathBuf};

/// An error of this crate: what is wrong, where, and what to do about it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file or folder could not be read or written.
    #[error(
        "{path}: cannot {action}: {source}; {remedy}",
        path = Printable(path.display()), remedy = io_remedy(source)
    )]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The operation that failed, as a verb: "read", "create the folder", …
        action: &'static str,
        /// The system's reason.
        source: io::Error,
    },
    /// A file was read, but its content cannot be used.
    #[error(
        "{path}{place}: {what}; {remedy}",
        path = Printable(path.display()), place = Printable(place), what = Printable(what),
        remedy = Printable(remedy)
    )]
    Input {
        /// The file or folder.
        path: PathBuf,
        /// Position in the file, ready to append to the path (": line 12", ": column 'jawOpen', line 3"), or empty.
        place: String,
        /// The content that was found, and what was expected.
        what: String,
        /// The remedy.
        remedy: String,
    },
    /// A value handed to the API is not usable.
    #[error("{what}; {remedy}", what = Printable(what), remedy = Printable(remedy))]
    Invalid {
        /// The value and why it is refused.
        what: String,
        /// The remedy.
        remedy: String,
    },
    /// The device lacks what an update path needs.
    #[error("update path '{path}' is not available on {device}: {reason}; {remedy}")]
    Unsupported {
        /// The update path.
        path: &'static str,
        /// The device's name.
        device: String,
        /// The missing feature, extension or limit.
        reason: String,
        /// The alternative to use.
        remedy: String,
    },
    /// There is not enough memory, on the host or on the device. A smaller request may still fit.
    #[error("{what}; {remedy}", what = Printable(what))]
    OutOfMemory {
        /// The purpose and the size of the memory.
        what: String,
        /// The remedy.
        remedy: String,
    },
    /// The device is lost, and has to be created anew.
    #[error("Vulkan: {call} failed: ERROR_DEVICE_LOST; create the device anew; its buffers are gone")]
    DeviceLost {
        /// The call that reported it.
        call: &'static str,
    },
    /// Another Vulkan call failed.
    #[error("Vulkan: {call} failed: {result:?}; {remedy}")]
    Vulkan {
        /// The call.
        call: &'static str,
        /// The result that it returned.
        result: vk::Result,
        /// The remedy.
        remedy: &'static str,
    },
    /// There is no Vulkan device: no loader, no driver, or none in its list. The engine itself looks for none.
    #[error("{what}; {remedy}", what = Printable(what))]
    NoDevice {
        /// The part that is missing.
        what: String,
        /// The remedy.
        remedy: &'static str,
    },
}

/// Returns an error unless a condition holds: the one given, or [`Error::invalid`] with what is wrong and the remedy.
macro_rules! ensure {
    ($holds:expr, $error:expr) => {
        let holds: bool = $holds;
        if !holds {
            return Err($error);
        }
    };
    ($holds:expr, $what:expr, $remedy:expr) => {
        ensure!($holds, $crate::error::Error::invalid($what, $remedy))
    };
}
pub(crate) use ensure;

/// `Result` with the crate's [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// [`Error::invalid`] as a result.
pub(crate) fn refuse<T>(what: impl Into<String>, remedy: impl Into<String>) -> Result<T> {
    Err(Error::invalid(what, remedy))
}

/// Room for `count` elements. A failed allocation is an error; it does not end the process.
pub(crate) fn reserved<T>(count: usize, what: impl FnOnce() -> String) -> Result<Vec<T>> {
    let mut list = vec![];
    let has_room = list.try_reserve_exact(count).is_ok();
    let what = || format!("no memory for {}: {} MiB", what(), count.saturating_mul(size_of::<T>()).div_ceil(1 << 20));
    ensure!(has_room, Error::out_of_memory(what(), "free memory, or use a smaller file"));
    Ok(list)
}

/// A word or name of a file, cut to a length that fits a message.
pub(crate) fn shortened(text: &str) -> String {
    match text.char_indices().nth(40) {
        Some((at, _)) => format!("{}…", &text[..at]),
        None => text.to_owned(),
    }
}

/// The first few names in quotes, and the number of the others.
pub(crate) fn listed(names: &[impl AsRef<str>]) -> String {
    let few: Vec<String> = names.iter().take(10).map(|name| format!("'{}'", shortened(name.as_ref()))).collect();
    let more = names.len() - few.len();
    few.join(", ") + &if more > 0 { format!(" and {more} more") } else { String::new() }
}

/// Text that may repeat a file's name or content. Control characters are escaped, so that no file can control the
/// terminal that shows the message.
pub struct Printable<T>(pub T);

impl<T: Display> Display for Printable<T> {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        self.0.to_string().chars().try_for_each(|c| match c.is_control() {
            true => write!(f, "{}", c.escape_default()),
            false => f.write_char(c),
        })
    }
}

/// The remedy for an error of the system.
#[allow(clippy::wildcard_enum_match_arm, reason = "the system's enum, of which a few have a remedy")]
fn io_remedy(error: &io::Error) -> &'static str {
    use io::ErrorKind as Kind;
    // ERROR_SHARING_VIOLATION.
    if cfg!(windows) && error.raw_os_error() == Some(32) {
        return "close the program that has it open";
    }
    match error.kind() {
        Kind::OutOfMemory => "free memory, or use a smaller file",
        Kind::NotFound | Kind::NotADirectory | Kind::IsADirectory | Kind::InvalidFilename => "check the path",
        Kind::PermissionDenied => "check the permissions",
        Kind::ReadOnlyFilesystem => "choose a place that can be written to",
        Kind::StorageFull | Kind::QuotaExceeded => "free some space, or choose another disk",
        _ => "see the system's message",
    }
}

/// The remedy if a buffer cannot be allocated.
pub(crate) const LESS: &str = "free memory, or use fewer instances, slots or frames in flight, 16-bit poses (fixed16) \
                               or the format 'small'";

/// The remedy for a call that returned `result`.
fn remedy(call: &str, result: vk::Result) -> &'static str {
    use vk::Result as Vk;
    match result {
        Vk::ERROR_OUT_OF_HOST_MEMORY
        | Vk::ERROR_OUT_OF_DEVICE_MEMORY
        | Vk::ERROR_OUT_OF_POOL_MEMORY
        | Vk::ERROR_FRAGMENTED_POOL
        | Vk::ERROR_FRAGMENTATION
        | Vk::ERROR_MEMORY_MAP_FAILED => match call {
            "vkAllocateMemory"
            | "vkCreateBuffer"
            | "vkBindBufferMemory"
            | "vkMapMemory"
            | "vkCreateBufferView"
            | "vkCreateDescriptorPool"
            | "vkAllocateDescriptorSets" => LESS,
            "vkCreateImage" | "vkBindImageMemory" | "vkCreateImageView" | "vkCreateSwapchainKHR" => {
                "free memory, or use smaller images"
            }
            // The request is small in any case.
            _ => "free memory: end other programs, or destroy what is no longer needed",
        },
        Vk::ERROR_TOO_MANY_OBJECTS => "destroy what is no longer needed",
        Vk::ERROR_SURFACE_LOST_KHR | Vk::ERROR_NATIVE_WINDOW_IN_USE_KHR => "open the window anew",
        Vk::ERROR_INCOMPATIBLE_DRIVER | Vk::ERROR_INITIALIZATION_FAILED => {
            "check that a Vulkan 1.1 driver is installed and works (on Linux ./with-vulkan installs lavapipe), or use the path \
             'cpu'"
        }
        _ => "this is a bug in deltamorph or in the driver: run with the validation layers on",
    }
}

impl Error {
    /// The number of the variant, which is the result of functions of the C API. Numbers are never reused; new ones are
    /// added at the end.
    pub const fn number(&self) -> u32 {
        match self {
            Self::Io { .. } => 1,
            Self::Input { .. } => 2,
            Self::Invalid { .. } => 3,
            Self::Unsupported { .. } => 4,
            Self::OutOfMemory { .. } => 5,
            Self::DeviceLost { .. } => 6,
            Self::Vulkan { .. } => 7,
            Self::NoDevice { .. } => 8,
        }
    }

    /// Returns a function for `map_err` that makes an error, with a fitting remedy, from the result of the Vulkan
    /// function `call`.
    #[doc(hidden)]
    pub fn vulkan(call: &'static str) -> impl Fn(vk::Result) -> Self {
        use vk::Result as Vk;
        move |result| match result {
            Vk::ERROR_OUT_OF_HOST_MEMORY | Vk::ERROR_OUT_OF_DEVICE_MEMORY | Vk::ERROR_OUT_OF_POOL_MEMORY => {
                Self::out_of_memory(format!("Vulkan: {call} failed: {result:?}"), remedy(call, result))
            }
            Vk::ERROR_DEVICE_LOST => Self::DeviceLost { call },
            _ => Self::Vulkan { call, result, remedy: remedy(call, result) },
        }
    }

    /// Returns a function for `map_err` that makes an error from the system's.
    pub(crate) fn io(path: &Path, action: &'static str) -> impl Fn(io::Error) -> Self {
        move |source| {
            if source.kind() == io::ErrorKind::OutOfMemory {
                let what = format!("{}: cannot {action}: {source}", path.display());
                return Self::out_of_memory(what, io_remedy(&source));
            }
            Self::Io { path: path.to_path_buf(), action, source }
        }
    }

    /// Makes an [`Error::Input`].
    #[doc(hidden)]
    pub fn input(path: &Path, place: impl Into<String>, what: impl Into<String>, remedy: &str) -> Self {
        Self::Input { path: path.to_path_buf(), place: place.into(), what: what.into(), remedy: remedy.into() }
    }

    /// Makes an [`Error::OutOfMemory`].
    pub(crate) fn out_of_memory(what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::OutOfMemory { what: what.into(), remedy: remedy.into() }
    }

    /// Makes an [`Error::Invalid`].
    #[doc(hidden)]
    pub fn invalid(what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Invalid { what: what.into(), remedy: remedy.into() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn io(kind: io::ErrorKind) -> Error {
        Error::io(Path::new("a/b.obj"), "read")(kind.into())
    }

    /// Hosts store these numbers: one that changes is a breaking change.
    #[test]
    fn errors_have_stable_numbers() {
        let (vulkan, none) = (Error::vulkan("vkCall"), String::new);
        let all = [
            (1, io(io::ErrorKind::NotFound)),
            (2, Error::input(Path::new("a"), "", "what", "remedy")),
            (3, Error::invalid("what", "remedy")),
            (4, Error::Unsupported { path: "compute", device: none(), reason: none(), remedy: none() }),
            (5, Error::out_of_memory("what", "remedy")),
            (5, io(io::ErrorKind::OutOfMemory)),
            (5, vulkan(vk::Result::ERROR_OUT_OF_HOST_MEMORY)),
            (5, vulkan(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY)),
            (5, vulkan(vk::Result::ERROR_OUT_OF_POOL_MEMORY)),
            (6, vulkan(vk::Result::ERROR_DEVICE_LOST)),
            (7, vulkan(vk::Result::ERROR_INITIALIZATION_FAILED)),
            (8, Error::NoDevice { what: none(), remedy: "" }),
        ];
        for (number, error) in all {
            assert_eq!(error.number(), number, "{error:?}");
        }
        let lost = vulkan(vk::Result::ERROR_DEVICE_LOST).to_string();
        assert!(lost.starts_with("Vulkan: vkCall failed: ERROR_DEVICE_LOST; create the device anew"), "{lost}");
    }

    #[test]
    fn what_a_file_says_cannot_steer_the_terminal() {
        let what = "'\u{1b}[2J' is not a number, ä is";
        let text = Error::input(Path::new("a\u{7}b.csv"), ": column '\u{9b}2J'", what, "mend it");
        assert_eq!(text.to_string(), r"a\u{7}b.csv: column '\u{9b}2J': '\u{1b}[2J' is not a number, ä is; mend it");
        assert_eq!(Error::invalid("target 'a\nb'", "rename it").to_string(), r"target 'a\nb'; rename it");
    }
}
