//! Tests of the command line.

use super::bench::SuiteChoice;
use super::values::*;
use super::*;
use clap::CommandFactory;

fn parse(line: &str) -> Result<Cli, clap::Error> {
    Cli::try_parse_from(line.split_whitespace())
}

fn bench(line: &str) -> BenchArgs {
    match parse(line).expect(line).command {
        Command::Bench(args) => *args,
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_definition_is_consistent() {
    Cli::command().debug_assert();
}

#[test]
fn defaults() {
    let args = bench("deltamorph bench");
    assert!(args.batch_sizes.is_empty());
    assert!(args.changed.is_empty());
    assert_eq!((args.heads_or(&[1]), args.frames, args.warmup, args.time_limit().as_secs()), (vec![1], 100, 5, 5));
    assert!(args.suites.is_empty() && !args.shared);
    assert_eq!((args.update.slots, args.input.tolerance), (2, 1e-6));
    assert!(args.update.formats.is_empty());
    assert!(args.update.paths.is_empty());
    assert_eq!(args.report, PathBuf::from("bench-report"));
    assert_eq!(args.input.head.desc(1), HeadDesc::default());
    assert_eq!(args.input.tolerance(), Tolerance::default());
}

#[test]
fn lists_and_aliases() {
    let args = bench(
        "deltamorph bench face --path feedback,cpu --format float32,snorm16 --batch-sizes 1..3,7,max --changed 4,all \
         --weights a.csv --weights b.csv --heads 1,16 --device 1",
    );
    assert_eq!(args.update.paths, [UpdatePath::Feedback, UpdatePath::Cpu]);
    assert_eq!(args.update.formats, [DeltaFormat::Float32, DeltaFormat::Snorm16]);
    assert_eq!(args.batch_sizes, [BatchSpec::Range(1, Some(3)), BatchSpec::Size(7), BatchSpec::Max]);
    assert_eq!(args.changed, [ChangedSpec::Count(4), ChangedSpec::All]);
    assert_eq!((args.weights.len(), args.heads.as_slice()), (2, &[1, 16][..]));
    let global = parse("deltamorph --device 1 devices").expect("global before").global;
    assert_eq!(global.device, Some(DeviceChoice::Index(1)));
    let global = parse("deltamorph info --device llvmpipe --json -").expect("global after").global;
    assert_eq!(global.device, Some(DeviceChoice::Name("llvmpipe".into())));
    assert_eq!(global.json, Some(PathBuf::from("-")));
}

#[test]
fn bad_values_are_refused_with_exit_code_2() {
    for line in [
        "bench --vertices 0",
        "bench --vertices -1",
        "bench --sparsity 0",
        "bench --sparsity 1.01",
        "bench --sparsity nan",
        "bench --tolerance -1e-6",
        "bench --tolerance inf",
        "bench --batch-sizes 0",
        "bench --batch-sizes 7..1",
        "bench --batch-sizes 1..",
        "bench --slots 0",
        "bench --frames 0",
        "bench --heads 0",
        "bench --paths vulkan",
        "bench --formats half",
        "bench --mode both",
        "bench --fps 0",
        "bench --report a --no-report",
        "bench face --redraw report.json",
        "apply --set jawOpen",
        "apply --set =1 -o a.obj",
        "apply --set jawOpen=nan -o a.obj",
        "apply face --weights a.csv -o a.obj",
        "apply face --frame 3 -o a.obj",
        "apply face --batch-size 1..3 --set a=1 -o a.obj",
        "apply face --set a=1",
        "sample",
        "lod face",
    ] {
        let error = parse(&format!("deltamorph {line}")).expect_err(line);
        assert_eq!(error.exit_code(), 2, "{line}");
    }
}

#[test]
fn suites_take_what_makes_sense_to_them() {
    let args =
        bench("deltamorph bench --suite crowd,clips --time-limit 0.2 --heads 1,3 --frames 5 --paths blocks,compute");
    assert_eq!(args.suites, [SuiteChoice::Crowd, SuiteChoice::Clips]);
    assert_eq!((args.heads_or(&[7]), args.time_limit().as_millis()), (vec![1, 3], 200));
    for line in
        ["--time-limit 1", "--suite all --changed 3", "--suite all --shared", "--suite all --mode rebuild", "--suite x"]
    {
        assert_eq!(parse(&format!("deltamorph bench {line}")).expect_err(line).exit_code(), 2, "{line}");
    }
}

#[test]
fn messages_say_what_would_be_right() {
    let message = |line: &str| parse(line).expect_err(line).to_string();
    assert!(message("deltamorph bench --vertices 0").contains("from 1 to"));
    assert!(message("deltamorph bench --batch-sizes 7..1").contains("write 1..7"));
    assert!(message("deltamorph bench --sparsity 2").contains("above 0 and at most 1"));
}

#[test]
fn apply_checks_what_clap_cannot() {
    let apply = |line: &str| match parse(line).expect(line).command {
        Command::Apply(args) => *args,
        other => panic!("{other:?}"),
    };
    let args = apply("deltamorph apply face --set a=b=0.5,c=-1 --set d=2 -o out.obj");
    let set: Vec<_> = args.set.iter().map(|s| (s.name.as_str(), s.weight)).collect();
    assert_eq!(set, [("a=b", 0.5), ("c", -1.0), ("d", 2.0)]);
    let single = args.update.single("apply", UpdatePath::Cpu).expect("one of each");
    assert_eq!((args.check(), single.path), (Ok(()), UpdatePath::Cpu));
    let format = |options: &str, held| {
        let args = apply(&format!("deltamorph apply face --set a=1 -o out.obj {options}"));
        args.update.single("apply", UpdatePath::Cpu).expect("one of each").delta_format(held)
    };
    let small = Some(DeltaFormat::Small);
    assert_eq!((format("", None), format("", small)), (Ok(DeltaFormat::Fast), Ok(DeltaFormat::Small)));
    assert_eq!(format("--path compute", small), Ok(DeltaFormat::Float32));
    assert_eq!(format("--format fast", small), Ok(DeltaFormat::Fast));
    assert!(apply("deltamorph apply face -o out.obj").check().is_err());
    assert!(apply("deltamorph apply face --set a=1 --path cpu,compute -o out.obj").check().is_err());
    assert!(apply("deltamorph apply --weights a.csv --frame 9 --from-frame 3 -o out.obj").check().is_ok());
}

#[test]
fn batches_are_expanded_within_the_limit() {
    use deltamorph::BatchSize::{All, Targets};
    let spec = [BatchSpec::All, BatchSpec::Range(3, None), BatchSpec::Size(1), BatchSpec::Max, BatchSpec::Size(9)];
    let (kept, refused) = expand_batches(&spec, BatchLimit { max: 5, all: false });
    assert_eq!(kept, [Targets(1), Targets(3), Targets(4), Targets(5)]);
    assert_eq!(refused, [Targets(9), All]);
    let (kept, _) = expand_batches(&spec[..1], BatchLimit { max: 5, all: true });
    assert_eq!(kept, [All]);
    assert_eq!(expand_batches(&spec, BatchLimit { max: 0, all: true }), (vec![All], vec![]));
    assert_eq!(expand_batches(&[BatchSpec::Range(7, None)], BatchLimit { max: 5, all: true }), (vec![], vec![]));
}

#[test]
fn changed_counts_are_expanded() {
    let spec = [ChangedSpec::All, ChangedSpec::Count(3), ChangedSpec::Count(8)];
    assert_eq!(expand_changed(&spec, 8), Ok(vec![3, 8]));
    assert!(expand_changed(&spec, 7).unwrap_err().contains("7 targets"));
}
