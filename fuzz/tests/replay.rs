//! Each seed, and each input of corpus/ and regressions/, once, as `cargo test` of the library runs: without libFuzzer,
//! and without coverage instrumentation. Memory and time are held to what is stated here, too.

use deltamorph_fuzz::Target;
use deltamorph_fuzz::targets::TARGETS;
use std::path::Path;

fn replay(target: &Target) -> Vec<String> {
    let mut failed = vec![];
    let mut run = |what: String, input: Vec<u8>| {
        // An input that ends the process, or never ends, is the last that is named.
        eprintln!("{what}");
        if std::panic::catch_unwind(|| (target.run)(&input)).is_err() {
            failed.push(what);
        }
    };
    (target.seeds)().into_iter().for_each(|(seed, input)| run(format!("the seed {seed}"), input));
    for folder in ["corpus", "regressions"] {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder).join(target.name);
        let mut files: Vec<_> =
            folder.read_dir().into_iter().flatten().map(|file| file.expect("a file").path()).collect();
        files.sort();
        files.into_iter().for_each(|path| run(path.display().to_string(), std::fs::read(&path).expect("a file")));
    }
    failed
}

#[test]
fn no_input_fails() {
    let failed: Vec<String> = TARGETS.iter().flat_map(replay).collect();
    assert!(failed.is_empty(), "these fail: {failed:#?}");
}
