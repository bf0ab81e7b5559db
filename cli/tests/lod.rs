//! `lod`: its JSON, pins, the file of an order, and errors.

#[path = "common/cli.rs"]
mod cli;

use cli::{HEAD, fails, json, ok, sample};

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
        // An order knows nothing of the clip: a few targets may happen to be those that it hardly uses.
        for p in &curve[1..3] {
            assert!(p["error_random_rel"].as_f64() > p["error_rel"].as_f64(), "{metric}: {p}");
        }
        assert_eq!((curve[3]["error_rel"].as_f64(), curve[3]["error_random_rel"].as_f64()), (Some(0.0), Some(0.0)));
    }
    let out = json(&["lod", &head, "--pin", "eyeBlink", "--out", file, "--json", "-"]);
    assert!(listed(&out)[..2].iter().all(|name| name.starts_with("eyeBlink")), "{out}");
    assert_eq!(json(&["lod", &head, "--from", file, "--json", "-"]), out);
    assert!(ok(&["lod", &head, "--from", file]).contains("yes"));
    let (code, text) = fails(&["lod", &head, "--pin", "nothing"]);
    assert!(code == 2 && text.contains("--pin nothing: no target of"), "{text}");
    let (_, text) = fails(&[&["lod", "--from", file], &["--vertices", "1200", "--targets", "13"][..]].concat());
    assert!(text.contains("head.lod.json: does not rank the target"), "{text}");
}

#[test]
fn twins_of_a_symmetric_face_score_alike_in_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let order = folder.path().join("order.json");
    let head = ["--vertices", "6000", "--targets", "52", "--random", "1"];
    let all = json(&[&["lod", "--metric", "all", "--json", "-"], &head[..]].concat());
    let rankings = all["rankings"].as_array().unwrap();
    assert_eq!((rankings.len(), all["agreement"].as_array().unwrap().len()), (5, 10));
    let names = listed(&rankings[3]);
    assert_eq!(rankings[3]["metric"], "ssim");
    let place = |name: &str| names.iter().position(|n| n == name).unwrap_or_else(|| panic!("{name}"));
    let lefts: Vec<&String> = names.iter().filter(|n| n.ends_with("Left") && n.len() > "mouthLeft".len()).collect();
    assert!(lefts.len() >= 15, "{lefts:?}");
    let score = |name: &str| rankings[3]["ranking"][place(name)]["score"].as_f64().unwrap();
    let mut side_by_side = 0;
    for left in &lefts {
        let right = left.replace("Left", "Right");
        let (a, b) = (score(left), score(&right));
        // What is left are the pixels that edges fall on.
        assert!(a.max(b) <= 1.25 * a.min(b), "{left}: {a} {b}");
        side_by_side += usize::from(place(left).abs_diff(place(&right)) == 1);
    }
    assert!(2 * side_by_side >= lefts.len(), "{side_by_side} of {}: {names:?}", lefts.len());
    let (code, text) = fails(&[&["lod", "--metric", "all", "--out", order.to_str().unwrap()], &HEAD[..]].concat());
    assert!(code == 2 && text.contains("--out keeps one order"), "{text}");
}
