//! The real data sets, where they are unpacked (see data/README.md).

use std::path::PathBuf;

/// The folder of the set `name`; `None`, with a remark on stderr, where it is not there.
pub fn set(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("DELTAMORPH_DATA").map(|root| PathBuf::from(root).join(name));
    let found = folder.filter(|folder| folder.join("neutral.obj").is_file() || folder.join("README.txt").is_file());
    if found.is_none() {
        let thread = std::thread::current();
        let test = thread.name().unwrap_or("this test");
        eprintln!("left out: {test} needs the data set {name} (set DELTAMORPH_DATA)");
    }
    found
}
