//! `lod`: its JSON, pinned targets, the order's file, and errors.

use crate::cli::{HEAD, fails, json, ok, refused, sample};
use crate::data;
use std::collections::HashMap;
use std::path::Path;

fn listed(out: &serde_json::Value) -> Vec<String> {
    let ranking = out["ranking"].as_array().expect("a list");
    ranking.iter().map(|r| r["name"].as_str().expect("a name").to_owned()).collect()
}

#[test]
fn an_order_loses_less_than_random_ones_and_is_kept_with_its_pins() {
    let folder = tempfile::tempdir().unwrap();
    let head = sample(folder.path());
    let file = folder.path().join("head.lod.json");
    let file = file.to_str().unwrap();
    for metric in ["mse", "hausdorff"] {
        let out = json(&["lod", &head, "--metric", metric, "--json", "-"]);
        assert_eq!((&out["schema"], &out["metric"]), (&1.into(), &metric.into()));
        let scores: Vec<f64> =
            out["ranking"].as_array().unwrap().iter().map(|r| r["score"].as_f64().unwrap()).collect();
        assert!(scores.len() == 12 && scores.windows(2).all(|w| w[0] >= w[1]), "{scores:?}");
        let curve = out["curve"].as_array().unwrap();
        assert_eq!(curve.iter().map(|p| p["kept"].as_u64().unwrap()).collect::<Vec<_>>(), [3, 6, 9, 12]);
        // An order does not depend on the clip: some of its targets may be hardly used.
        for p in &curve[1..3] {
            assert!(p["error_random_rel"].as_f64() > p["error_rel"].as_f64(), "{metric}: {p}");
        }
        assert_eq!((curve[3]["error_rel"].as_f64(), curve[3]["error_random_rel"].as_f64()), (Some(0.0), Some(0.0)));
    }
    let out = json(&["lod", &head, "--pin", "eyeBlink", "--out", file, "--json", "-"]);
    assert!(listed(&out)[..2].iter().all(|name| name.starts_with("eyeBlink")), "{out}");
    let sheet = folder.path().join("sheet.png");
    let files = ["--sheet", sheet.to_str().unwrap(), "--frame", "12"];
    assert_eq!(json(&[&["lod", &head, "--from", file, "--json", "-"], &files[..]].concat()), out);
    // All 12 targets, and 9, 6 and 3 of them: the more are missing, the more pixels differ from the first picture.
    let sheet = image::open(sheet).unwrap().into_rgb8();
    assert_eq!(sheet.dimensions(), (4 * 256, 256 + 30));
    let differ = |column: u32| {
        let pixels = (0..256).flat_map(|y| (0..256).map(move |x| (x, y)));
        pixels.filter(|(x, y)| sheet.get_pixel(*x, *y) != sheet.get_pixel(column * 256 + x, *y)).count()
    };
    assert!(0 < differ(1) && differ(1) < differ(2) && differ(2) < differ(3), "{:?}", [1, 2, 3].map(differ));
    refused(&["lod", &head, "--sheet", "sheet.png", "--frame", "24"], 2, "--frame 24: the clips have 24 frames");
    assert!(ok(&["lod", &head, "--from", file]).contains("yes"));
    refused(&["lod", &head, "--pin", "nothing"], 2, "--pin nothing: no target of");
    let (_, text) = fails(&[&["lod", "--from", file], &["--vertices", "1200", "--targets", "13"][..]].concat());
    assert!(text.contains("head.lod.json: does not rank the target"), "{text}");
}

/// Writes the built-in head as a folder, with mirrored halves: rings of its faces are cut into triangles in the same
/// direction on both sides, so those of the left half replace those of the right one.
fn symmetric_head(folder: &Path) -> String {
    let dir = folder.join("symmetric").to_str().expect("UTF-8").to_owned();
    ok(&["sample", &dir, "--vertices", "3000", "--targets", "52", "--frames", "24"]);
    let path = Path::new(&dir).join("neutral.obj");
    let text = std::fs::read_to_string(&path).expect("text");
    let rows = |kind: &'static str| text.lines().filter_map(move |line| line.strip_prefix(kind));
    let bits = |[x, y, z]: [f32; 3]| [x + 0.0, y, z].map(f32::to_bits);
    let numbers = |row: &str| -> Vec<f32> { row.split_whitespace().map(|n| n.parse().expect("a number")).collect() };
    let vertices: Vec<[f32; 3]> = rows("v ").map(|row| numbers(row).try_into().expect("three")).collect();
    // Vertices of several parts may coincide: the nth one is paired with the nth at its mirror image.
    let mut places: HashMap<[u32; 3], Vec<usize>> = HashMap::new();
    (0..vertices.len()).for_each(|v| places.entry(bits(vertices[v])).or_default().push(v));
    let across = |v: usize| {
        let (here, [x, y, z]) = (&places[&bits(vertices[v])], vertices[v]);
        places[&bits([-x, y, z])][here.iter().position(|other| *other == v).expect("itself")]
    };
    let mut lines = String::new();
    let mut faces = 0;
    for row in rows("f ") {
        let corner = |c: &str| c.split('/').next().expect("a part").parse::<usize>().expect("a number") - 1;
        let face: Vec<usize> = row.split_whitespace().map(corner).collect();
        if face.iter().all(|v| vertices[*v][0] >= 0.0) {
            let line = |face: &mut dyn Iterator<Item = usize>| {
                face.fold("f".to_owned(), |line, v| format!("{line} {}", v + 1)) + "\n"
            };
            lines += &line(&mut face.iter().copied());
            lines += &line(&mut face.iter().rev().map(|v| across(*v)));
            faces += 1;
        }
    }
    assert!(faces > 2000, "{faces}");
    let targets =
        std::fs::read_dir(Path::new(&dir).join("targets")).expect("a folder").map(|e| e.expect("a file").path());
    for file in targets.chain([path]) {
        let text = std::fs::read_to_string(&file).expect("text");
        let others = text.lines().filter(|line| !line.starts_with("f ")).map(|line| format!("{line}\n"));
        std::fs::write(&file, others.collect::<String>() + &lines).expect("written");
    }
    dir
}

#[test]
fn twins_of_a_symmetric_face_are_side_by_side_in_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let head = symmetric_head(folder.path());
    let out = json(&["lod", &head, "--metric", "ssim", "--random", "1", "--json", "-"]);
    assert_eq!(out["twins"], serde_json::json!({ "pairs": 20, "side_by_side": 20, "apart": [] }));
    let score = |name: &str| {
        let ranked = out["ranking"].as_array().unwrap().iter().find(|r| r["name"] == name);
        ranked.unwrap_or_else(|| panic!("{name}"))["score"].as_f64().unwrap()
    };
    for left in listed(&out).iter().filter(|name| name.ends_with("Left")) {
        let (a, b) = (score(left), score(&left.replace("Left", "Right")));
        // Sums in another order: a pixel may round differently.
        assert!((a - b).abs() <= 1e-3 * a, "{left}: {a} {b}");
    }
}

#[test]
#[ignore = "a minute: .ci/deep"]
fn all_metrics_rank_all_targets_and_say_how_far_they_agree() {
    let folder = tempfile::tempdir().unwrap();
    let order = folder.path().join("order.json");
    let all = json(&[&["lod", "--metric", "all", "--random", "1", "--json", "-"], &HEAD[..]].concat());
    let rankings = all["rankings"].as_array().unwrap();
    let metrics: Vec<&str> = rankings.iter().map(|r| r["metric"].as_str().unwrap()).collect();
    assert_eq!(metrics, ["mse", "hausdorff", "image-mse", "ssim", "perceptual", "yee"]);
    for ranking in rankings {
        let last = ranking["curve"].as_array().unwrap().last().unwrap();
        assert_eq!((listed(ranking).len(), last["error_rel"].as_f64()), (12, Some(0.0)), "{ranking}");
        assert!(ranking["ranking"][0]["score"].as_f64().unwrap() > 0.0, "{ranking}");
    }
    assert_eq!(all["agreement"].as_array().unwrap().len(), 15);
    refused(
        &[&["lod", "--metric", "all", "--out", order.to_str().unwrap()], &HEAD[..]].concat(),
        2,
        "--out keeps one order",
    );
}

#[test]
#[ignore = "a minute: .ci/deep"]
fn half_of_the_targets_of_captured_clips_lose_at_most_half_of_what_random_halves_do() {
    for name in ["facecap_head_glb", "ict_facekit", "makehuman_face"] {
        let Some(set) = data::set(name) else { continue };
        for metric in ["mse", "hausdorff"] {
            let out = json(&["lod", set.to_str().expect("UTF-8"), "--metric", metric, "--json", "-"]);
            let [error, random] = ["error_rel", "error_random_rel"].map(|key| out["curve"][1][key].as_f64().unwrap());
            assert!(error > 0.0 && error <= 0.5 * random, "{name}, {metric}: {error} {random}");
        }
    }
}
