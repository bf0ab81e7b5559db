//! Memory of readers of text files, regardless of the counts in a file, against the documented limits.
//! glTF and packed files have such tests beside their readers (src/import/gltf/tests, src/pack/file/tests).

use deltamorph::import::csv;
use deltamorph::import::obj::ObjFile;
use std::path::Path;

/// Reads a file of `size` bytes within `each` bytes of memory per byte, plus 1 MiB.
fn within<T>(size: usize, each: usize, read: impl FnOnce() -> T) -> T {
    let mut result = None;
    let memory = allocation_counter::measure(|| result = Some(read()));
    let most = (1 << 20) + (each * size) as u64;
    assert!(memory.bytes_max <= most, "{} bytes for a file of {size}, {most} at most", memory.bytes_max);
    result.expect("measured")
}

/// Half a megabyte of a text.
fn many(text: &str) -> String {
    text.repeat((1 << 19) / text.len())
}

#[test]
fn of_obj_files() {
    let lists = "v 0 0 0\nvt 0 0\nvn 0 0 1\n";
    let lines = [lists, "v 0 0 0\n", "vt 0 0 \\\n\n", "vn 0 0 1 # -\r\n", "f 1 1 1\n", "f 1/1/1 -1/-1/-1 1//1\n"];
    let faces = [" 1", " -1", " 1/1", " 1//1", " 1/1/1"].map(|corner| format!("f 1 1{}\n", many(corner)));
    for text in lines.map(many).into_iter().chain(faces) {
        let text = format!("{lists}{text}");
        within(text.len(), 300, || ObjFile::from_bytes(Path::new("a.obj"), text.into())).unwrap();
    }
}

#[test]
fn of_clips() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    for (columns, rows, long) in [(1, 100_000, 0), (50, 5000, 0), (50_000, 1, 0), (50_000, 0, 0), (50, 50, 9000)] {
        for cell in ["0", "0.5", "\"1e-3\"", "  -1  "] {
            let names: Vec<String> = (0..columns).map(|i| format!("c{i}{}", "x".repeat(long))).collect();
            let text = names.join(",") + "\n" + &(vec![cell; columns].join(",") + "\n").repeat(rows);
            std::fs::write(&path, &text).unwrap();
            let clip = within(text.len(), 200, || csv::read(&path, None)).unwrap();
            assert_eq!((clip.names.len(), clip.values.len()), (columns, columns * rows));
        }
    }
}
