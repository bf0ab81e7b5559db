//! Names of targets, which are compared in Unicode's composed form (NFC): file systems and programs decompose letters.

/// The index of the first of `names` that is `name`, in any Unicode form.
pub fn index_of<'a>(mut names: impl Iterator<Item = &'a str>, name: &str) -> Option<usize> {
    let wanted = composed(name);
    names.position(|other| other == name || composed(other) == wanted)
}

/// The composed form of a name. Without a reader of files, names are compared as the host gives them.
#[cfg(any(feature = "obj", feature = "gltf", feature = "csv"))]
pub fn composed(name: &str) -> String {
    unicode_normalization::UnicodeNormalization::nfc(name).collect()
}

#[cfg(not(any(feature = "obj", feature = "gltf", feature = "csv")))]
pub fn composed(name: &str) -> String {
    name.to_owned()
}
