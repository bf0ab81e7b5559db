//! Tests of the command line.

use super::values::*;
use super::*;
use clap::CommandFactory;

fn parse(line: &str) -> Result<Cli, clap::Error> {
    Cli::try_parse_from(format!("deltamorph {line}").split_whitespace())
}

/// The arguments of one command.
macro_rules! args {
    ($command:ident, $line:expr) => {
        match parse($line).expect($line).command {
            Command::$command(args) => *args,
            other => panic!("{other:?}"),
        }
    };
}

#[test]
fn the_definition_is_consistent() {
    Cli::command().debug_assert();
}

#[test]
fn names_that_a_shell_has_cut_are_whole_again() {
    let words = |line: &str| line.split(' ').map(OsString::from).collect::<Vec<_>>().into_iter();
    for (line, name) in [("--set smile, wide=0.5 -o x", "smile, wide"), ("--set frown =0.5 -o x", "frown ")] {
        let line = words(&format!("deltamorph apply face {line}"));
        let Command::Apply(args) = Cli::try_parse_from(with_whole_settings(line)).expect(name).command else {
            panic!("it is `apply`");
        };
        assert_eq!(args.set, [vec![(name.to_owned(), 0.5)]]);
    }
    let kept = "deltamorph apply face --set a=1 --set b -o x=1";
    assert!(words(kept).eq(with_whole_settings(words(kept))));
}

#[test]
fn lists_and_aliases() {
    let args = args!(
        Bench,
        "bench face --path feedback,cpu --format float32,snorm16 --batch-sizes 1..3,7,max --changed 4,all \
         --weights a.csv --weights b.csv --heads 1,16 --device 1"
    );
    assert_eq!(args.update.paths, [UpdatePath::Feedback, UpdatePath::Cpu]);
    assert_eq!(args.update.formats, [DeltaFormat::Float32, DeltaFormat::Snorm16]);
    assert_eq!(args.batch_sizes, [BatchSpec::Range(1, Some(3)), BatchSpec::Size(7), BatchSpec::Max]);
    assert_eq!(args.changed, [Some(4), None]);
    assert_eq!((args.weights.len(), args.heads.as_slice()), (2, &[1, 16][..]));
    let args = args!(Apply, "apply face --set a=b=0.5,c=-1 --set d=2 -o out.obj");
    assert_eq!(args.set.concat(), [("a=b".into(), 0.5), ("c".into(), -1.0), ("d".into(), 2.0)]);
    for (text, expected) in [
        ("smile, wide=0.5", &[("smile, wide", 0.5)][..]),
        (" a =1, b=2,c=d,e=3", &[(" a ", 1.0), ("b", 2.0), ("c=d,e", 3.0)]),
        (",=1", &[(",", 1.0)]),
    ] {
        let named = |(name, weight): &(&str, f32)| ((*name).to_owned(), *weight);
        assert_eq!(settings(text).unwrap(), expected.iter().map(named).collect::<Vec<_>>());
    }
    assert!(settings("a=0,5").is_err() && settings("a=1,").is_err());
    let args = args!(Play, "play face --error-budget 1e-4d");
    assert_eq!(args.run.update.budget(2.0), 2e-4);
    for (line, device) in
        [("--device 1 devices", DeviceChoice::Index(1)), ("info --device a", DeviceChoice::Name("a".into()))]
    {
        assert_eq!(parse(line).expect(line).global.device, Some(device));
    }
}

#[test]
fn bad_values_are_refused_with_exit_code_2_and_what_would_be_right() {
    for (command, options) in [
        (
            "bench",
            "--vertices 0|--vertices -1|--sparsity 0|--sparsity 1.01|--sparsity nan|--fps 0|--slots 0|--frames 0",
        ),
        ("bench", "--tolerance -1e-6|--tolerance inf|--batch-sizes 0|--batch-sizes 7..1|--batch-sizes 1..|--heads 0"),
        ("bench", "--paths vulkan|--formats half|--mode both|--report a --no-report"),
        ("bench", "--suite x|face --vertices 3|face --sparsity 0.5"),
        ("bench --suite all", "--time-limit 0|--changed 3|--mode rebuild|--constant x"),
        ("apply", "--set jawOpen -o a.obj|--set =1 -o a.obj|--set jawOpen=nan -o a.obj|face --set a=1"),
        ("apply face -o a.obj", "--frame 3|--batch-size 1..3 --set a=1"),
        ("play", "face --noise 0|face --noise nan|face --every 0|--path gpu|--batch-size 1..3"),
        ("play", "--block-size 33|--error-budget 1px|--pose fixed8|--weight-max 0|--weight-max -1"),
        ("soak", "|--frames 0|--frames 5 --every 0"),
        ("sample", ""),
        ("lod face", "--metric half|--random 0|--set jawOpen=1"),
        #[cfg(feature = "viewer")]
        ("view face", "--size 640|--screenshot"),
        ("rank", "face"),
    ] {
        for options in options.split('|') {
            let line = format!("{command} {options}");
            assert_eq!(parse(&line).expect_err(&line).exit_code(), 2, "{line}");
        }
    }
}

#[test]
fn batches_are_expanded_within_the_limit() {
    use deltamorph::BatchSize::{All, Targets};
    let spec = [BatchSpec::All, BatchSpec::Range(3, None), BatchSpec::Size(1), BatchSpec::Max, BatchSpec::Size(9)];
    let (kept, refused) = expand_batches(&spec, UpdatePath::Feedback, 5);
    assert_eq!(kept, [Targets(1), Targets(3), Targets(4), Targets(5)]);
    assert_eq!(refused, [Targets(9), All]);
    let (kept, _) = expand_batches(&spec[..1], UpdatePath::Compute, 5);
    assert_eq!(kept, [All]);
    assert_eq!(expand_batches(&spec, UpdatePath::Compute, 0), (vec![All], vec![]));
    assert_eq!(expand_batches(&[BatchSpec::Range(7, None)], UpdatePath::Compute, 5), (vec![], vec![]));
}

#[test]
fn changed_counts_are_expanded() {
    let spec = [None, Some(3), Some(8)];
    assert_eq!(expand_changed(&spec, 8), Ok(vec![3, 8]));
    assert!(expand_changed(&spec, 7).unwrap_err().contains("7 targets"));
}
