//! The one error type of the crate: every variant names the thing, the value and the remedy.

use std::io::ErrorKind;
use std::path::PathBuf;

/// What went wrong, where, and what to do about it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file or folder could not be read or written.
    #[error("{path}: cannot {action}: {source}; {remedy}", path = path.display(), remedy = io_remedy(source.kind()))]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What was tried, as a verb: "read", "create the folder", …
        action: &'static str,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A file was read, but what it says cannot be used.
    #[error("{path}{place}: {what}; {remedy}", path = path.display())]
    Input {
        /// The file or folder.
        path: PathBuf,
        /// Where in it, ready to append to the path (": line 12", ": column 'jawOpen', line 3"), or empty.
        place: String,
        /// What was found there, and what was expected.
        what: String,
        /// What to do.
        remedy: String,
    },
    /// A value handed to the API is not usable.
    #[error("{what}; {remedy}")]
    Invalid {
        /// The value and why it is refused.
        what: String,
        /// What to do.
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
        /// What to use in its place.
        remedy: String,
    },
    /// A Vulkan call failed.
    #[error("Vulkan: {call} failed: {result}; {remedy}")]
    Vulkan {
        /// The call.
        call: &'static str,
        /// The result code, spelled out.
        result: String,
        /// What to do.
        remedy: &'static str,
    },
}

/// `Result` with the crate's [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What to do about a system's error.
fn io_remedy(kind: ErrorKind) -> &'static str {
    match kind {
        ErrorKind::NotFound | ErrorKind::NotADirectory | ErrorKind::IsADirectory | ErrorKind::InvalidFilename => {
            "check the path"
        }
        ErrorKind::PermissionDenied => "check the permissions",
        ErrorKind::ReadOnlyFilesystem => "choose a place that can be written to",
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => "free some space, or choose another disk",
        _ => "see the system's message",
    }
}

impl Error {
    /// An [`Error::Invalid`].
    pub(crate) fn invalid(what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Invalid { what: what.into(), remedy: remedy.into() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_access_has_a_remedy() {
        let text =
            |kind: ErrorKind| Error::Io { path: "a/b.obj".into(), action: "read", source: kind.into() }.to_string();
        assert_eq!(text(ErrorKind::NotFound), "a/b.obj: cannot read: entity not found; check the path");
        assert_eq!(text(ErrorKind::PermissionDenied), "a/b.obj: cannot read: permission denied; check the permissions");
        assert!(text(ErrorKind::StorageFull).ends_with("; free some space, or choose another disk"));
        assert!(text(ErrorKind::BrokenPipe).ends_with("; see the system's message"));
    }
}
