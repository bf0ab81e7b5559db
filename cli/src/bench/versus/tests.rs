//! Comparisons of made-up reports.

use super::pairs::{Pair, Verdict};
use super::*;
use crate::bench::record::{Round, RunRecord};
use crate::bench::stats::Stats;
use crate::bench::synthetic;
use deltamorph::BatchSize;

/// Ten rounds around `ms`, none like the others.
fn rounds(ms: f64) -> Vec<Round> {
    (0..10).map(|i| ms * (0.97 + 0.006 * f64::from(i))).map(|ms| Round { ms, update_ms: ms }).collect()
}

/// A report with a run for each batch size from 1, which takes so many ms.
fn report(times: &[f64]) -> Report {
    let [run, ..] = &synthetic::report().runs[..] else { panic!("it has runs") };
    let run = |(i, ms): (usize, &f64)| {
        let rounds = rounds(*ms);
        let gpu_ms = Stats::of(&rounds.iter().map(|round| round.ms).collect::<Vec<_>>());
        RunRecord { batch_size: BatchSize::Targets(i as u32 + 1), gpu_ms, rounds, ..run.clone() }
    };
    Report { runs: times.iter().enumerate().map(run).collect(), ..synthetic::report() }
}

fn compared(reports: &[&Report]) -> Comparison {
    let named: Vec<_> =
        reports.iter().enumerate().map(|(i, report)| (format!("{i}/report.json"), (*report).clone())).collect();
    Comparison::new(&named).expect("some in common")
}

fn verdicts(found: &Against) -> Vec<Verdict> {
    found.configurations.iter().map(|pair| pair.verdict).collect()
}

#[test]
fn differences_are_found_and_noise_is_none() {
    use Verdict::{Faster, NotSignificant, Slower};
    let before = report(&[10.0, 10.0, 10.0, 10.0]);
    let found = compared(&[&before, &report(&[8.0, 10.05, 12.0, 10.0])]);
    let [against] = &found.comparisons[..] else { panic!("one other") };
    assert_eq!(verdicts(against), [Faster, NotSignificant, Slower, NotSignificant]);
    assert_eq!((against.faster, against.not_significant, against.slower), (1, 2, 1));
    for (pair, ratio) in against.configurations.iter().zip([0.8, 1.005, 1.2, 1.0]) {
        let Pair { ratio: Some(r), low: Some(low), high: Some(high), .. } = *pair else { panic!("{pair:?}") };
        assert!((r - ratio).abs() < 1e-12 && low < r && r < high && high / low < 1.06, "{pair:?}");
        assert_eq!((pair.test, pair.n, pair.time), (Some("ranks"), [10, 10], "update"));
    }
    let mean = (0.8f64 * 1.005 * 1.2).powf(0.25);
    assert!(against.ratio_mean.is_some_and(|m| (m - mean).abs() < 1e-12));
    // Every sample of one above the other: as clear as ten rounds can be, four times.
    let p = 4.0 * 2.0 / 184_756.0;
    assert!(against.configurations[0].p_corrected.is_some_and(|found| (found - p).abs() < 1e-12));
    assert!(found.warnings.is_empty(), "{:?}", found.warnings);
    // A report is no different from itself.
    let same = compared(&[&before, &before]);
    assert_eq!(verdicts(&same.comparisons[0]), [NotSignificant; 4]);
    assert_eq!(same.comparisons[0].ratio_mean, Some(1.0));
}

#[test]
fn reports_without_rounds_are_compared_by_their_errors() {
    let bare = |times: &[f64]| {
        let mut report = report(times);
        report.runs.iter_mut().for_each(|run| run.rounds.clear());
        report
    };
    let found = compared(&[&bare(&[10.0, 10.0]), &bare(&[11.0, 10.05])]);
    let pairs = &found.comparisons[0].configurations;
    assert_eq!(verdicts(&found.comparisons[0]), [Verdict::Slower, Verdict::NotSignificant]);
    assert!(pairs.iter().all(|pair| pair.test == Some("standard errors")));
    // One frame tells nothing.
    let one = |ms: f64| {
        let mut report = bare(&[ms]);
        report.runs[0].gpu_ms = Stats::of(&[ms]);
        report
    };
    let found = compared(&[&one(1.0), &one(5.0)]);
    assert_eq!(verdicts(&found.comparisons[0]), [Verdict::Undecided]);
    assert_eq!(found.comparisons[0].configurations[0].ratio, Some(5.0));
}

#[test]
fn only_the_same_work_is_compared() {
    let before = report(&[10.0, 10.0, 10.0]);
    let mut after = report(&[10.0, 10.0]);
    after.runs[1].format = "fast".into();
    let found = compared(&[&before, &after]);
    let against = &found.comparisons[0];
    assert_eq!((against.configurations.len(), against.only_in_baseline.len(), against.only_here.len()), (1, 2, 1));
    assert_eq!((&against.only_here[0]["format"], &against.only_here[0]["batch_size"]), (&"fast".into(), &2.into()));
    for change in [
        |run: &mut RunRecord| run.path = "blocks".into(),
        |run: &mut RunRecord| run.mode = "rebuild".into(),
        |run: &mut RunRecord| run.pose = "fixed32".into(),
        |run: &mut RunRecord| run.changed = 3.0,
        |run: &mut RunRecord| run.heads = 7,
        |run: &mut RunRecord| run.slots = 3,
        |run: &mut RunRecord| run.mesh = "other".into(),
        |run: &mut RunRecord| run.shared = true,
        |run: &mut RunRecord| run.workload = "speech".into(),
        |run: &mut RunRecord| run.cell = "dense".into(),
    ] {
        let mut other = before.clone();
        change(&mut other.runs[0]);
        assert_eq!(compared(&[&before, &other]).comparisons[0].configurations.len(), 2);
    }
    // Versions without pose formats had float32 alone; of a clip, frames may change as many as they like.
    let mut old = before.clone();
    old.runs[0].pose.clear();
    let mut clip = before.clone();
    clip.runs.iter_mut().for_each(|run| run.workload = "speech".into());
    let mut other = clip.clone();
    other.runs[0].changed = 2.5;
    // The same work twice: each has its own.
    let mut twice = before.clone();
    twice.runs.extend(before.runs.clone());
    for (a, b, common) in [(&before, &old, 3), (&clip, &other, 3), (&twice, &twice, 6), (&before, &twice, 3)] {
        assert_eq!(compared(&[a, b]).comparisons[0].configurations.len(), common);
    }
    let mut foreign = before.clone();
    foreign.runs.iter_mut().for_each(|run| run.path = "blocks".into());
    let error = Comparison::new(&[("a".into(), before.clone()), ("b".into(), foreign.clone())]).expect_err("nothing");
    let text = error.to_string();
    assert!(text.contains("path: feedback in the one, blocks in the other") && text.contains("same INPUT"), "{text}");
    // Of three, one may be of no use.
    let found = compared(&[&before, &before, &foreign]);
    assert!(
        found.warnings.iter().any(|warning| warning.starts_with("C (2/report.json) has no configuration in common"))
    );
    assert!(page(&found).contains("Only in C: 3"));
}

#[test]
fn other_machines_and_meshes_are_told() {
    let before = report(&[10.0]);
    let mut after = before.clone();
    after.device.name = "Another".into();
    after.device.threads = 64;
    after.input.vertices = 12;
    let warnings = compared(&[&before, &after]).warnings;
    assert_eq!(warnings.len(), 3, "{warnings:?}");
    for (warning, words) in warnings.iter().zip(["Example GPU <1> in A, Another in B", "64 threads", "12 vertices"]) {
        assert!(warning.contains(words), "{warning}");
    }
}

#[test]
fn wrong_runs_are_told_and_not_compared() {
    let before = report(&[10.0, 10.0]);
    let mut after = report(&[10.0, 10.0]);
    let run = &mut after.runs[1];
    (run.verified, run.gpu_ms, run.problem) = (false, None, Some("vertex <17> is off".into()));
    run.rounds.clear();
    let found = compared(&[&before, &after]);
    let against = &found.comparisons[0];
    assert_eq!(verdicts(against), [Verdict::NotSignificant, Verdict::Wrong]);
    let wrong = &against.configurations[1];
    assert_eq!((wrong.ratio, wrong.p, wrong.problem.as_deref()), (None, None, Some("B: vertex <17> is off")));
    let page = page(&found);
    assert!(page.contains("B: vertex &lt;17&gt; is off") && page.contains("1 wrong"), "{page}");
    let text = page::text(&found);
    assert!(text.contains("1 wrong") && text.contains("What it cannot tell: whether the program"), "{text}");
}

/// A time that one of them lacks is no reason to compare two different times.
#[test]
fn the_same_times_are_compared() {
    let before = report(&[10.0]);
    let mut after = report(&[10.0]);
    after.runs[0].gpu_ms = None;
    let pair = &compared(&[&before, &after]).comparisons[0].configurations[0];
    assert_eq!((pair.time, pair.test), ("round trip", Some("standard errors")), "{pair:?}");
    assert_eq!(pair.ms, after.runs[0].cpu_ms.map(|time| time.median));
}

fn page(found: &Comparison) -> String {
    let drawn: Vec<_> = found.comparisons.iter().map(|_| None).collect();
    page::page(found, &page::links(&[], Path::new(".")), &drawn)
}

#[test]
fn the_folder_is_complete_and_its_links_hold() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let reports = [report(&[10.0, 10.0]), report(&[8.0, 10.0]), report(&[10.0, 14.0])];
    // One with a page, in a folder whose name addresses cannot have; one that was saved alone.
    let files = [at("a #1 100%/report.json"), at("b.json"), at("c/report.json")];
    for (report, file) in reports.iter().zip(&files) {
        std::fs::create_dir_all(file.parent().expect("a folder")).expect("made");
        std::fs::write(file, to_json(report).expect("text")).expect("written");
    }
    report::write(&reports[0], &at("a #1 100%")).expect("written");
    let named: Vec<_> = files.iter().map(|file| file.display().to_string()).zip(reports).collect();
    let found = Comparison::new(&named).expect("some in common");
    let dir = at("deep/er");
    claim(&dir).expect("new");
    write(&found, &files, &dir).expect("written");
    claim(&dir).expect("ours");
    let page = std::fs::read_to_string(dir.join("index.html")).expect("read");
    for part in [
        "href=\"../../a%20%231%20100%25/index.html\"",
        "href=\"../../b.json\"",
        "href=\"ratios-c.svg\"",
        "B against A: 2 configurations are in both; 1 faster, 0 slower, 1 not significantly",
        "On geometric average C takes 18.3 % more time",
        "data-n=\"0.8\"",
    ] {
        assert!(page.contains(part), "{part}");
    }
    assert_eq!(page.matches("its page").count(), 1);
    for name in ["ratios-b.svg", "ratios-b.png", "ratios-c.png", "comparison.json"] {
        assert!(dir.join(name).is_file(), "{name}");
    }
    let json: Value = serde_json::from_slice(&std::fs::read(dir.join("comparison.json")).expect("read")).expect("JSON");
    for (place, fields) in [
        ("", "schema version reports warnings comparisons"),
        ("/reports/0", "name file version created command device input runs"),
        (
            "/comparisons/0",
            "name baseline faster slower not_significant undecided wrong ratio_mean configurations only_in_baseline \
             only_here",
        ),
        (
            "/comparisons/0/configurations/0",
            "path mode format pose batch_size changed heads slots mesh verdict time baseline_ms ms n ratio low high p \
             p_corrected test",
        ),
    ] {
        let object = json.pointer(place).expect(place);
        fields.split(' ').for_each(|field| assert!(object.get(field).is_some(), "{place}/{field}"));
    }
    assert_eq!(json["comparisons"][0]["configurations"][0]["verdict"], "faster");
    // What was there before is not ours.
    std::fs::write(dir.join("comparison.json"), "{}").expect("written");
    assert!(claim(&dir).is_err_and(|e| e.to_string().contains("--report")));
}
