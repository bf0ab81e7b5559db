//! A folder of OBJ files: the neutral, then targets, separated by zero bytes.

use crate::{Memory, Random, Target, bounded, check_error, pack_and_update, parts, scratch, write};
use deltamorph::import::obj::{ObjFile, import_folder};
use deltamorph::{Mesh, Tolerance};
use std::fs;
use std::path::Path;

pub const TARGET: Target = Target { name: "obj", run, mutate, seeds: Vec::new };

const MEMORY: Memory = Memory { base: 1 << 20, per_byte: 300 };

fn run(data: &[u8]) {
    let [neutral, targets @ ..] = parts::<4>(data);
    // Most files are refused by themselves, and need no folder.
    let read = || ObjFile::from_bytes(Path::new("neutral.obj"), neutral.to_vec());
    if let Err(error) = bounded("ObjFile::from_bytes", neutral.len(), MEMORY, read) {
        return check_error(error);
    }
    let folder = scratch().join("obj");
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(folder.join("targets")).expect("a folder");
    write("obj/neutral.obj", neutral);
    for (i, target) in targets.iter().enumerate().filter(|(_, target)| !target.is_empty()) {
        write(&format!("obj/targets/t{i}.obj"), target);
    }
    match bounded("import_folder", data.len(), MEMORY, || import_folder(&folder)) {
        Ok(source) => mesh_of(source, data),
        Err(error) => check_error(error),
    }
}

fn mesh_of(mut source: Mesh, data: &[u8]) {
    let choice = crc32fast::hash(data);
    let changed = match choice % 4 {
        0 => source.split().map(|split| source = split),
        1 => source.weld().map(drop),
        _ => Ok(()),
    };
    changed.unwrap_or_else(check_error);
    let tolerance = if choice.is_multiple_of(2) { Tolerance::default() } else { Tolerance::ZERO };
    match bounded("Mesh::pack", data.len(), MEMORY, || source.kept(tolerance)) {
        Ok(mesh) => pack_and_update(&mesh, choice / 8),
        Err(error) => check_error(error),
    }
}

/// Repeats and removes lines and words.
fn mutate(data: &[u8], random: &mut Random) -> Option<Vec<u8>> {
    let divider = *random.choose(b"\n\n\n  /\0");
    let mut pieces: Vec<&[u8]> = data.split(|byte| *byte == divider).collect();
    let (from, to) = (random.below(pieces.len()), random.below(pieces.len()));
    let words: [&[u8]; 19] = [
        b"f 1 2",
        b"f 1 2 3 4 5 6 7 8",
        b"1.#QNAN",
        b"v 1 2 3",
        b"vn 0 0 1",
        b"vt 0 1",
        b"f 1 2 3",
        b"f 1/1/1 2/2/1 3/3/1 4//1",
        b"f -1 -2 -3",
        b"s off",
        b"0",
        b"1",
        b"-1",
        b"4294967296",
        b"1e39",
        b"1e-46",
        b"nan",
        b"\\\n",
        b"\r",
    ];
    match random.below(4) {
        0 => _ = pieces.remove(from),
        1 => pieces[to] = pieces[from],
        2 => drop(pieces.splice(to..to, vec![pieces[from]; 1 << random.below(10)])),
        _ => pieces[to] = words[random.below(words.len())],
    }
    Some(pieces.join(&divider))
}
