//! The container of a packed file: header, table of sections, checksums.

use crate::error::{Error, Result, ensure};
use std::path::Path;

/// Magic bytes. A transfer in text mode changes the line end, and is detected.
const MAGIC: [u8; 8] = *b"DMORPH\r\n";
/// The version without clips, and with clips.
const VERSION: u32 = 6;
const WITH_CLIPS: u32 = 7;
/// Most groups of a file, since some data is kept per target and group.
pub(super) const GROUPS_MAX: usize = 16;
/// Bytes of the header, of a table row, and of the checksum after the table.
const HEADER: usize = 16;
const ROW: usize = 24;
const TAIL: usize = 8;
const ALIGNMENT: usize = 8;

/// Remedy for a file damaged in transfer.
const DAMAGED: &str = "the file is damaged: copy it again, or pack the mesh again";

/// Remedy for a file of another version.
const OUTDATED: &str = "pack the mesh again with this program, or read it with the one that wrote it";

/// A section: table id, and name in messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Section(u32, &'static str);

macro_rules! sections {
    ($($name:ident $id:literal $text:literal)*) => {
        $(pub(super) const $name: Section = Section($id, $text);)*
    };
}

sections! {
    META 1 "meta"
    NAMES 2 "names"
    BASE 3 "base pose"
    ORDER 4 "order"
    FIRST_ENTRIES 5 "first entries"
    ENTRY_TARGETS 6 "entry targets"
    WORDS 7 "words"
    FACES 8 "face sizes"
    CORNERS 9 "face corners"
    CORNER_TEXCOORDS 10 "corner texcoords"
    TEXCOORDS 11 "texcoords"
    GROUP 12 "group"
    WELDS 13 "welds"
    CLIPS 14 "clips"
}

/// Sections that occur once, in file order; the last one in files with clips.
const ONCE: [Section; 9] = [META, NAMES, ORDER, FACES, CORNERS, CORNER_TEXCOORDS, TEXCOORDS, WELDS, CLIPS];
/// Sections of each group, which follow.
const EACH: [Section; 5] = [GROUP, BASE, FIRST_ENTRIES, ENTRY_TARGETS, WORDS];

/// A section and its group; 0 for sections that occur once.
pub(super) type Place = (Section, usize);

/// The sections of a file in order; `None` if no file has this many.
pub(super) fn places(version: u32, sections: usize) -> Option<Vec<Place>> {
    let once = if version == WITH_CLIPS { &ONCE[..] } else { &ONCE[..8] };
    let rest = sections.checked_sub(once.len())?;
    let groups = rest / EACH.len();
    if rest != groups * EACH.len() || !(1..=GROUPS_MAX).contains(&groups) {
        return None;
    }
    let once = once.iter().map(|section| (*section, 0));
    Some(once.chain((0..groups).flat_map(|group| EACH.iter().map(move |section| (*section, group)))).collect())
}

fn id((section, group): Place) -> u32 {
    section.0 + ((group as u32) << 8)
}

pub(super) struct Sections<'a> {
    path: &'a Path,
    /// Each with its checksum.
    contents: Vec<(Place, u32, &'a [u8])>,
}

impl<'a> Sections<'a> {
    /// The bytes of a section; none if the file does not have it.
    pub fn get(&self, place: Place) -> Result<&'a [u8]> {
        let found = self.contents.iter().find(|(at, ..)| *at == place);
        let Some((_, checksum, bytes)) = found else { return Ok(&[]) };
        let refuse = || malformed(self.path, Some(place), "the checksum does not match", DAMAGED);
        ensure!(crc32fast::hash(bytes) == *checksum, refuse());
        Ok(bytes)
    }

    /// The number of groups.
    pub fn groups(&self) -> usize {
        self.contents.iter().map(|((_, group), ..)| group + 1).max().unwrap_or(0)
    }
}

/// An error about a section, or about the file if `place` is `None`.
pub(super) fn malformed(path: &Path, place: Option<Place>, what: impl Into<String>, remedy: &str) -> Error {
    let place = match place {
        None => String::new(),
        Some((Section(_, name), 0)) => format!(": section '{name}'"),
        Some((Section(_, name), group)) => format!(": section '{name}' of group {group}"),
    };
    Error::input(path, place, what, remedy)
}

/// Builds a file of `contents`, which are in the order of [`places`].
pub(super) fn join(contents: &[(Place, Vec<u8>)]) -> Vec<u8> {
    let start = HEADER + ROW * contents.len() + TAIL;
    let total = contents.iter().fold(start, |at, (_, c)| at + c.len().next_multiple_of(ALIGNMENT));
    let mut out = Vec::with_capacity(total);
    out.extend(MAGIC);
    let has_clips = contents.iter().any(|(place, _)| place.0 == CLIPS);
    out.extend(if has_clips { WITH_CLIPS } else { VERSION }.to_le_bytes());
    out.extend((contents.len() as u32).to_le_bytes());
    let mut at = start;
    for (place, content) in contents {
        out.extend(id(*place).to_le_bytes());
        out.extend(crc32fast::hash(content).to_le_bytes());
        out.extend((at as u64).to_le_bytes());
        out.extend((content.len() as u64).to_le_bytes());
        at += content.len().next_multiple_of(ALIGNMENT);
    }
    out.extend(crc32fast::hash(&out).to_le_bytes());
    out.extend(0u32.to_le_bytes());
    for (_, content) in contents {
        out.extend(content);
        out.resize(out.len().next_multiple_of(ALIGNMENT), 0);
    }
    out
}

/// Splits a file into sections, checking every byte outside of them.
pub(super) fn split<'a>(path: &'a Path, bytes: &'a [u8]) -> Result<Sections<'a>> {
    let refuse = |what: String, remedy: &str| malformed(path, None, what, remedy);
    let ends = |within: &str| refuse(format!("ends after {} bytes, within {within}", bytes.len()), DAMAGED);
    let magic = bytes.get(..MAGIC.len()).unwrap_or(bytes);
    let begins = MAGIC.starts_with(magic) && !bytes.is_empty();
    let remedy = "give a file written by `deltamorph pack`";
    ensure!(begins, refuse("does not begin as a packed mesh does".into(), remedy));
    let (Some(version), Some(count)) = (u32_at(bytes, 8), u32_at(bytes, 12)) else { return Err(ends("the header")) };
    let what = format!("has version {version} of the format; this program reads versions {VERSION} and {WITH_CLIPS}");
    ensure!((VERSION..=WITH_CLIPS).contains(&version), refuse(what, OUTDATED));
    let Some(places) = places(version, count as usize) else {
        return Err(refuse(format!("has {count} sections, which no file of version {version} has"), DAMAGED));
    };
    let table = HEADER + ROW * places.len();
    let (Some(checksum), Some(zero)) = (u32_at(bytes, table), u32_at(bytes, table + 4)) else {
        return Err(ends("the table of sections"));
    };
    let matches = crc32fast::hash(&bytes[..table]) == checksum && zero == 0;
    ensure!(matches, refuse("the checksum of its header does not match".into(), DAMAGED));
    let mut at = table + TAIL;
    let mut contents = Vec::with_capacity(places.len());
    for (i, place) in places.into_iter().enumerate() {
        let row = HEADER + ROW * i;
        let word = |at: usize| u32_at(bytes, row + at).unwrap_or(0);
        let long = |at: usize| u64::from(word(at)) | u64::from(word(at + 4)) << 32;
        let has = word(0);
        let offset = long(8);
        let length = long(16);
        let refuse = |what: String| malformed(path, Some(place), what, DAMAGED);
        let what = format!("lies at {offset} with id {has}; at {at} with id {} expected", id(place));
        ensure!((has, offset) == (id(place), at as u64), refuse(what));
        let what = format!("has {length} bytes at {offset}, but the file ends after {}", bytes.len());
        ensure!(length <= (bytes.len() - at) as u64, refuse(what));
        let end = at + length as usize;
        let next = end.next_multiple_of(ALIGNMENT);
        let padding = bytes.get(end..next);
        let padding = padding.ok_or_else(|| refuse(format!("ends at {}; padding expected", bytes.len())))?;
        ensure!(padding.iter().all(|b| *b == 0), refuse("is not padded with zeros".into()));
        contents.push((place, word(4), &bytes[at..end]));
        at = next;
    }
    ensure!(at == bytes.len(), refuse(format!("has {} bytes after the last section", bytes.len() - at), DAMAGED));
    Ok(Sections { path, contents })
}

pub(super) fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..)?.first_chunk().map(|b| u32::from_le_bytes(*b))
}

/// A number of things as files have it.
pub(super) fn counted(count: usize) -> Result<u32> {
    let what = |_| Error::invalid(format!("a list or name of {count} in a .dmorph file"), "split what has so many");
    u32::try_from(count).map_err(what)
}

/// Appends a name: its length in bytes, and UTF-8.
pub(super) fn push_name(out: &mut Vec<u8>, name: &str) -> Result<()> {
    out.extend(counted(name.len())?.to_le_bytes());
    out.extend(name.as_bytes());
    Ok(())
}

/// Takes a number from the front.
pub(super) fn u32_of(rest: &mut &[u8]) -> Result<u32, String> {
    let number = rest.split_off(..4).and_then(|bytes| u32_at(bytes, 0));
    number.ok_or_else(|| "ends within a number".to_owned())
}

/// Takes a name from the front.
pub(super) fn name_of<'a>(rest: &mut &'a [u8]) -> Result<&'a str, String> {
    let length = u32_of(rest)? as usize;
    let name = rest.split_off(..length).ok_or_else(|| format!("ends within a name of {length} bytes"))?;
    std::str::from_utf8(name).map_err(|_| "has a name that is not UTF-8".to_owned())
}

/// Recompute the checksums of `bytes`, so that tests reach the checks that follow them.
#[cfg(test)]
pub(super) fn repair(bytes: &mut [u8]) {
    let Some(count) = u32_at(bytes, 12).filter(|count| *count < 1000) else { return };
    let table = HEADER + ROW * count as usize;
    if bytes.len() < table + TAIL {
        return;
    }
    for row in (HEADER..table).step_by(ROW) {
        let long = |at: usize| bytes[row + at..].first_chunk().map_or(0, |b| u64::from_le_bytes(*b));
        let offset = long(8) as usize;
        let length = long(16) as usize;
        if let Some(content) = offset.checked_add(length).and_then(|end| bytes.get(offset..end)) {
            let checksum = crc32fast::hash(content);
            bytes[row + 4..row + 8].copy_from_slice(&checksum.to_le_bytes());
        }
    }
    let checksum = crc32fast::hash(&bytes[..table]);
    bytes[table..table + 4].copy_from_slice(&checksum.to_le_bytes());
}
