//! What is refused: exit code 2 for bad arguments and 1 for failures, words that say why, and no file that is changed.

use crate::cli::{contents, ok, sample};
use std::process::Command;

/// Lines of arguments for the folder that [`refused_with_words`] makes; `BENCH` is a short one, `SET` sets a weight.
const LINES: &[(&str, i32, &str)] = &[
    ("bench --changed 99 --targets 12 --vertices 50", 2, "the mesh has 12 targets"),
    ("bench no/such/folder", 1, "no/such/folder"),
    ("bench head --no-report --paths direct --formats fast", 1, "direct: supports --formats float32,"),
    ("bench head --no-report --paths feedback --poses fixed16", 1, "and --poses float32"),
    ("bench --device GeForce --vertices 50", 1, "no Vulkan device called 'GeForce'"),
    ("devices --device GeForce", 1, "no such Vulkan device; choose one of: 0: "),
    ("apply head -o out.obj --set nose=1", 2, "--set nose: 'head' has no such target"),
    ("apply head -o out.obj", 2, "nothing to apply"),
    ("apply head -o out.obj --weights a.csv", 2, "give --weights CSV --frame N"),
    ("apply head -o - SET", 2, "name a file"),
    ("apply head -o out.obj SET,eyeBlinkLeft=0", 2, "set twice"),
    ("apply head -o /nonexistent/out.obj SET", 1, "/nonexistent/out.obj"),
    ("apply head -o out.obj SET --path direct --mode incremental", 2, "'rebuild'"),
    ("apply head -o out.obj SET --path scatter --format fast", 2, "supports small"),
    ("soak --frames 9 --vertices 99 --targets 15 --path direct-attributes --device SwiftShader", 1, "attributes for 7"),
    ("play head --path cpu,blocks", 2, "--path: play accepts only one; name one of them"),
    ("play head --mode incremental,rebuild", 2, "--mode: play accepts only one; name one of them"),
    ("play head --pose fixed16,fixed32", 2, "--pose: play accepts only one; name one of them"),
    ("play head --format fast,small", 2, "--format: play accepts only one; name one of them"),
    ("play head --weights none.csv --path cpu", 2, "none.csv"),
    ("play head --path cpu --format float32 --pose fixed32", 2, "'fast'"),
    ("play head --path compute --format small", 2, "float32 or snorm16"),
    ("play head --path scatter --pose fixed32", 2, "'scatter'"),
    ("play head --animated --pose float32", 1, "use fixed16 or fixed32"),
    ("play head --animated --path cpu", 2, "--animated"),
    ("play head --path cpu --json /nonexistent/x.json", 1, "/nonexistent/x.json"),
    ("play two --path cpu", 2, "2 clips"),
    ("play bare --path cpu", 2, "no clip"),
    ("render head", 2, "--output"),
    ("render head -o out.png --set nose=1", 2, "no such target"),
    ("render head -o out.png --weights clip.csv", 2, "--frame N"),
    ("render head -o out.png --weights clip.csv --frame 24", 2, "has no frame 24"),
    ("render head -o out.png --frame 1", 2, "--weights"),
    ("render head -o out.png --clip out.png", 2, "cannot be used with"),
    ("render head -o out.png --scale 1", 2, "--show heat"),
    ("render head -o out.png --show skin", 2, "wire"),
    ("render head -o out.png --show blocks --heat distance", 2, "cannot be used with"),
    ("render head -o out.png --show motion --slots 1 SET", 1, "two slots or more"),
    ("render head -o out.png --path direct", 2, "evaluates poses in its own draws"),
    ("render head -o out.png --path blocks,cpu", 2, "render"),
    ("render head -o head/neutral.obj", 2, "would be overwritten"),
    ("render head -o -", 2, "name a file"),
    ("render head -o out.png --device nowhere", 1, "nowhere"),
    ("info half.dmorph", 1, "half.dmorph: section"),
    ("info empty.DMORPH", 1, "empty.DMORPH: an empty file, where a packed mesh is expected"),
    ("info empty.glb", 1, "empty.glb: an empty file, where a glTF file is expected; download"),
    (
        "info empty.txt",
        1,
        "empty.txt: a file of a kind that is not read; give a folder with neutral.obj and targets/*.obj, a",
    ),
    ("info none.dmorph", 1, "none.dmorph: cannot read: No such file"),
    ("info packed.dmorph --tolerance 0.1", 2, "was packed with a tolerance of 0.000001"),
    ("apply packed.dmorph -o packed.dmorph SET", 2, "would be overwritten"),
    ("apply packed.dmorph -o out.obj SET --block-size 64", 2, "is packed already"),
    // What is written has the name of its kind.
    ("pack head -o head.glb", 2, "name it *.dmorph"),
    ("pack head -o new.dmorph --format snorm16", 2, "name one of fast, small"),
    ("render -o a.jpg", 2, "a PNG is written; name it *.png"),
    ("apply --set jawOpen=1 -o a.glb", 2, "an OBJ file is written; name it *.obj"),
    // Nothing that is read is written over.
    ("info head --json head/neutral.obj", 2, "is an input"),
    ("info head --json head/targets/eyeBlinkLeft.obj", 2, "is an input"),
    ("info packed.dmorph --json packed.dmorph", 2, "is an input"),
    #[cfg(unix)]
    ("info packed.dmorph --json link.json", 2, "is an input"),
    ("play head --weights clip.csv --json clip.csv", 2, "is an input"),
    ("soak head --frames 2 --json head/weights/head_30fps.csv", 2, "is an input"),
    ("bench head --no-report --weights clip.csv --json clip.csv", 2, "is an input"),
    ("apply head SET -o head/weights/head_30fps.csv", 2, "is an input"),
    ("apply head SET -o head/neutral.obj", 2, "is an input"),
    ("apply head SET -o new.obj --json head/neutral.obj", 2, "is an input"),
    ("pack packed.dmorph -o packed.dmorph", 2, "is an input"),
    // No two outputs are one file.
    ("pack head -o a.dmorph --json a.dmorph", 2, "would be overwritten; name another file"),
    ("pack head -o a.dmorph --json head/../a.dmorph", 2, "would be overwritten; name another file"),
    ("apply head SET -o a.obj --json head/../a.obj", 2, "would be overwritten; name another file"),
    ("BENCH --report report --json report/index.html", 2, "would be overwritten; name another file"),
    ("sample new --json new/neutral.obj", 2, "would be overwritten; name another file"),
    // What was there stays, and what is not complete goes.
    ("play head --weights bad.csv --json old.json", 1, "not a finite number"),
    ("play head --weights bad.csv --json new.json", 1, "not a finite number"),
    ("BENCH --report site", 2, "site"),
    ("BENCH --report old.json", 2, "old.json: is not a folder; name another one"),
    ("BENCH --report report --json /nonexistent/x.json", 1, "/nonexistent/x.json"),
    ("sample head", 2, "name a"),
    ("sample old.json", 2, "name a"),
    // A place for results is looked for before the input, which is not there either.
    ("apply gone SET -o no/x.obj", 1, "no/x.obj: cannot "),
    ("pack gone -o no/x.dmorph", 1, "no/x.dmorph: cannot "),
    ("render gone SET -o no/x.png", 1, "no/x.png: cannot "),
    ("render gone --weights a.csv --clip no/x.png", 1, "no/x.png: cannot "),
    ("render gone --weights a.csv --clip old.json/frames", 1, "old.json/frames: cannot "),
    ("sample old.json/head", 1, ": cannot "),
    ("play gone --json no/x.json", 1, "no/x.json: cannot "),
];

#[test]
fn refused_with_words() {
    let (folder, head) = sample();
    let at = |name: &str| folder.at(name);
    for name in ["two", "bare"] {
        ok(&["sample", &at(name), "--vertices", "60", "--targets", "3", "--frames", "2"]);
    }
    std::fs::copy(at("two/weights/head_30fps.csv"), at("two/weights/second.csv")).unwrap();
    std::fs::remove_dir_all(at("bare/weights")).unwrap();
    ok(&["pack", &head, "-o", &at("packed.dmorph")]);
    std::fs::copy(crate::cli::clip(&head), at("clip.csv")).unwrap();
    let packed = std::fs::read(at("packed.dmorph")).unwrap();
    folder.file("half.dmorph", &packed[..packed.len() / 2]);
    std::fs::create_dir(at("site")).unwrap();
    ["DMORPH", "glb", "txt"].iter().for_each(|kind| _ = folder.file(&format!("empty.{kind}"), ""));
    folder.file("bad.csv", "eyeBlinkLeft\ninf\n");
    ["old.json", "site/index.html"].iter().for_each(|name| _ = folder.file(name, "mine"));
    #[cfg(unix)]
    std::os::unix::fs::symlink(at("packed.dmorph"), at("link.json")).unwrap();
    let before = contents(folder.0.path());
    for (line, code, words) in LINES {
        let line = line.replace("BENCH", "bench --vertices 100 --targets 3 --frames 2 --paths cpu");
        let line = line.replace("SET", "--set eyeBlinkLeft=1");
        let mut program = Command::new(env!("CARGO_BIN_EXE_deltamorph"));
        let out = program.args(line.split(' ')).current_dir(folder.0.path()).output().expect("the program starts");
        let said = String::from_utf8(out.stderr).expect("text");
        assert!(out.status.code() == Some(*code) && said.contains(words), "{line}: {:?}, {said}", out.status);
        assert!(contents(folder.0.path()) == before, "{line}: files have changed");
    }
}
