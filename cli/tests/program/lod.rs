//! `lod`: its JSON, pinned targets, and errors.

use crate::cli::{HEAD, json, ok, refused, sample};
use crate::data;

fn listed(out: &serde_json::Value) -> Vec<String> {
    let ranking = out["ranking"].as_array().expect("a list");
    ranking.iter().map(|r| r["name"].as_str().expect("a name").to_owned()).collect()
}

#[test]
fn an_order_loses_less_than_random_ones_and_has_its_pins_first() {
    let (_folder, head) = sample();
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
    let out = json(&["lod", &head, "--pin", "eyeBlink", "--json", "-"]);
    assert!(listed(&out)[..2].iter().all(|name| name.starts_with("eyeBlink")), "{out}");
    assert!(ok(&["lod", &head, "--pin", "eyeBlink"]).contains("yes"));
    refused(&["lod", &head, "--pin", "nothing"], 2, "--pin nothing: no target of");
}

#[test]
#[ignore = "a minute: .ci/deep"]
fn all_metrics_rank_all_targets() {
    let all = json(&[&["lod", "--metric", "all", "--random", "1", "--json", "-"], &HEAD[..]].concat());
    let rankings = all["rankings"].as_array().unwrap();
    let metrics: Vec<&str> = rankings.iter().map(|r| r["metric"].as_str().unwrap()).collect();
    assert_eq!(metrics, ["mse", "hausdorff", "image-mse", "ssim", "perceptual"]);
    for ranking in rankings {
        let last = ranking["curve"].as_array().unwrap().last().unwrap();
        assert_eq!((listed(ranking).len(), last["error_rel"].as_f64()), (12, Some(0.0)), "{ranking}");
        assert!(ranking["ranking"][0]["score"].as_f64().unwrap() > 0.0, "{ranking}");
    }
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
