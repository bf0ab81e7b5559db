//! Memory of readers of text files, regardless of the counts in a file, against the documented limits.
//! glTF and packed files have such tests beside their readers (src/import/gltf/tests, src/pack/file/tests).

use deltamorph::import::csv;
use deltamorph::import::obj::ObjFile;
use proptest::prelude::*;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Reads a file of `size` bytes within `each` bytes of memory per byte, plus 1 MiB.
fn within<T>(size: usize, each: usize, read: impl FnOnce() -> T) -> T {
    let mut result = None;
    let memory = allocation_counter::measure(|| result = Some(read()));
    let most = (1 << 20) + (each * size) as u64;
    assert!(memory.bytes_max <= most, "{} bytes for a file of {size}, {most} at most", memory.bytes_max);
    result.expect("measured")
}

fn written(name: &str, bytes: &[u8]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

/// A count, small or large.
fn size() -> impl Strategy<Value = usize> {
    prop_oneof![2 => 0usize..20, 1 => 0usize..50_000]
}

/// The length of a name.
fn length() -> impl Strategy<Value = usize> {
    prop_oneof![3 => 0usize..9, 1 => 0usize..9000]
}

/// Limits `count` to half a megabyte of text, at `each` bytes per item.
fn room(count: usize, each: usize) -> usize {
    count.min((1 << 19) / each.max(1))
}

fn obj((counts, corners, forms, ends): ([usize; 4], usize, Vec<usize>, usize)) -> String {
    let [v, vt, vn, faces] = counts;
    let end = ["\n", "\r\n", " \\\n\n", " # -\n"][ends];
    let forms = forms.into_iter().map(|form| [" 1", " -1", " 1/1", " 1//1", " 1/1/1"][form]);
    let face = format!("f{}{end}", forms.cycle().take(3 + room(corners, 4)).collect::<String>());
    let lists = [("v 0 0 0", 1 + v), ("vt 0 0", 1 + vt), ("vn 0 0 1", 1 + vn)];
    let lists = lists.map(|(line, count)| format!("{line}{end}").repeat(count)).concat();
    lists + &face.repeat(room(faces, face.len()))
}

fn table((columns, rows, long, cell): (usize, usize, usize, usize)) -> String {
    let cell = ["0", "0.5", "\"1e-3\"", "  -1  "][cell];
    let columns = 1 + room(columns, long + 7);
    let names: Vec<String> = (0..columns).map(|i| format!("c{i}{}", "x".repeat(long))).collect();
    let row = vec![cell; columns].join(",") + "\n";
    names.join(",") + "\n" + &row.repeat(room(rows, row.len()))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    #[test]
    fn of_obj_files(
        counts in ([size(), size(), size(), size()], size(), prop::collection::vec(0usize..5, 1..4), 0usize..4),
    ) {
        let text = obj(counts);
        // A corner that refers to the last listed items is valid in every form.
        prop_assert!(within(text.len(), 300, || ObjFile::from_bytes(Path::new("a.obj"), text.clone().into())).is_ok());
    }

    #[test]
    fn of_clips(counts in (size(), size(), length(), 0usize..4)) {
        let text = table(counts);
        let (_folder, path) = written("a.csv", text.as_bytes());
        let clip = within(text.len(), 200, || csv::read(&path, None)).unwrap();
        prop_assert_eq!(clip.values.len() + clip.names.len(), text.lines().count() * clip.names.len());
    }

}
