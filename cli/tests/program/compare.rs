//! `bench --compare`: comparison of reports of earlier runs; other files are refused with a reason.

use crate::cli::{json, ok, refused};

/// A short bench.
const BENCH: [&str; 11] =
    ["bench", "--vertices", "200", "--targets", "4", "--paths", "cpu", "--changed", "all", "--quiet", "--frames"];

#[test]
fn reports_are_compared_configuration_by_configuration() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    for (name, more) in [("a", &["20"][..]), ("b", &["20"]), ("few", &["3", "--formats", "fast"])] {
        ok(&[&BENCH[..], more, &["--report", &at(name)]].concat());
    }
    let [a, b, few] = ["a", "b", "few"].map(|name| at(&format!("{name}/report.json")));
    let out = json(&["bench", "--compare", &a, &b, &few, "--json", "-"]);
    let [b_to_a, few_to_a] = &out["comparisons"].as_array().unwrap()[..] else { panic!("{out}") };
    let runs = out["reports"][0]["runs"].as_u64().unwrap() as usize;
    let pairs = b_to_a["configurations"].as_array().unwrap();
    assert_eq!((pairs.len(), &b_to_a["only_here"]), (runs, &serde_json::json!([])));
    for pair in pairs {
        let number = |place: &str| pair.pointer(place).and_then(serde_json::Value::as_f64).unwrap();
        for [low, median, high] in
            [["/baseline_spread/0", "/baseline_ms", "/baseline_spread/1"], ["/spread/0", "/ms", "/spread/1"]]
        {
            assert!(number(low) <= number(median) && number(median) <= number(high), "{pair}");
        }
        let overlap =
            number("/spread/0") <= number("/baseline_spread/1") && number("/baseline_spread/0") <= number("/spread/1");
        assert!(pair["n"] == serde_json::json!([10, 10]) && (pair["verdict"] == "within_spread") == overlap, "{pair}");
        assert!((number("/ratio") - number("/ms") / number("/baseline_ms")).abs() < 1e-9, "{pair}");
    }
    let few = few_to_a["configurations"].as_array().unwrap();
    assert!(!few.is_empty() && few.len() < runs && few.iter().all(|pair| pair["verdict"] == "undecided"), "{few_to_a}");
    assert_eq!(few_to_a["only_in_baseline"].as_array().unwrap().len(), runs - few.len());

    let text = ok(&["bench", "--compare", &a, &b]);
    assert!(text.contains("B / A") && text.contains("B against A: of ") && text.contains("B spread"), "{text}");
    refused(&["bench", "--compare", &a, &b, "--json", &a], 2, "would be written over");
}

#[test]
fn what_is_no_report_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    ok(&[&BENCH[..], &["3", "--report", &at("a")]].concat());
    let (a, info, other) = (at("a/report.json"), at("info.json"), at("other.json"));
    ok(&["info", "--vertices", "200", "--targets", "4", "--quiet", "--json", &info]);
    std::fs::write(&other, std::fs::read_to_string(&a).unwrap().replace("\"schema\": 1", "\"schema\": 7")).unwrap();
    for (args, code, words) in [
        (&["--compare", &a, &info][..], 1, "info.json: has no 'runs'; give a report.json"),
        (&["--compare", &a, &other], 1, "other.json: schema 7, this version reads schema 1"),
        (&["--compare", &a, &at("none.json")], 1, "none.json: cannot read"),
        (&["--compare", &at("a/runs.csv"), &a], 1, "runs.csv: is no JSON"),
    ] {
        refused(&[&["bench"], args].concat(), code, words);
    }
}
