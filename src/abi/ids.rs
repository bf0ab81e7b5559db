//! Ids of SPIR-V as differences between one and the next: modules that are alike are then equal for longer, and
//! compress to two thirds.

/// Words that are taken for ids. A module's first ids are types and constants, which are better left as they are; the
/// first word of an instruction is larger; any other number in between comes back as well.
const IDS: std::ops::Range<u32> = 192..1 << 14;

/// Replaces each id of a module by its difference to the one before, modulo the number of `IDS`.
pub fn to_differences(words: &mut [u32]) {
    let mut before = IDS.start;
    for word in words.iter_mut().filter(|word| IDS.contains(word)) {
        let id = std::mem::replace(&mut before, *word);
        *word = IDS.start + (IDS.end - IDS.start + *word - id) % (IDS.end - IDS.start);
    }
}

/// Undoes [`to_differences`].
pub fn from_differences(words: &mut [u32]) {
    let mut before = IDS.start;
    for word in words.iter_mut().filter(|word| IDS.contains(word)) {
        *word = IDS.start + (*word - IDS.start + before - IDS.start) % (IDS.end - IDS.start);
        before = *word;
    }
}
