//! Names of targets, which are compared in Unicode's composed form (NFC): file systems and programs decompose letters.

/// The composed form of a name. Without a reader of files, names are compared as the host gives them.
#[cfg(any(feature = "obj", feature = "gltf", feature = "csv"))]
pub fn composed(name: &str) -> String {
    unicode_normalization::UnicodeNormalization::nfc(name).collect()
}

#[cfg(not(any(feature = "obj", feature = "gltf", feature = "csv")))]
pub fn composed(name: &str) -> String {
    name.to_owned()
}
