//! Options of the commands that run many frames: `play` and `soak`.

use super::values::{self, BatchSpec};
use super::{InputArgs, UpdateArgs};
use clap::Args;
use deltamorph::UpdatePath;
use std::path::PathBuf;

/// Options of `play`.
#[derive(Args, Clone, Debug)]
pub struct PlayArgs {
    #[command(flatten)]
    pub input: InputArgs,
    #[command(flatten)]
    pub update: UpdateArgs,
    /// Weight clip to play [default: the one in INPUT/weights, where there is just one]
    #[arg(long, value_name = "CSV")]
    pub weights: Option<PathBuf>,
    /// Targets per pass: a number, "max" or "all" [default: the largest that the path allows]
    #[arg(long, value_name = "N", value_parser = values::one_batch)]
    pub batch_size: Option<BatchSpec>,
    /// Compare every Nth pose with the float64 reference, and the last one
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = values::at_least_one)]
    pub every: usize,
    /// Animate and plan on the device: it samples the clip, finds what changed and makes its own work list. Takes the
    /// path blocks and exact sums, and says nothing of what it planned
    #[arg(long)]
    pub animated: bool,
    /// Add noise up to ±AMOUNT to every weight in every frame, as a tracker does that is never quite still
    #[arg(long, value_name = "AMOUNT", value_parser = values::positive)]
    pub noise: Option<f32>,
}

/// Options of `soak`.
#[derive(Args, Clone, Debug)]
pub struct SoakArgs {
    #[command(flatten)]
    pub input: InputArgs,
    #[command(flatten)]
    pub update: UpdateArgs,
    /// Number of frames
    #[arg(long, value_name = "N", value_parser = values::frames)]
    pub frames: usize,
    /// Weight clip to take captured frames from [default: all in INPUT/weights]
    #[arg(long, value_name = "CSV")]
    pub weights: Option<PathBuf>,
    /// Targets per pass: a number, "max" or "all" [default: the largest that the path allows]
    #[arg(long, value_name = "N", value_parser = values::one_batch)]
    pub batch_size: Option<BatchSpec>,
    /// Compare every Nth pose with the float64 reference, and the last one [default: a 64th of the frames]
    #[arg(long, value_name = "N", value_parser = values::frames)]
    pub every: Option<usize>,
}

impl PlayArgs {
    /// Complain about what clap cannot see.
    pub fn check(&self) -> Result<(), String> {
        self.update.single("play", UpdatePath::Blocks).map(drop)
    }
}

impl SoakArgs {
    /// Complain about what clap cannot see.
    pub fn check(&self) -> Result<(), String> {
        self.update.single("soak", UpdatePath::Blocks).map(drop)
    }

    /// Frames from one comparison to the next.
    pub fn every(&self) -> usize {
        self.every.unwrap_or(self.frames / 64).max(1)
    }
}

#[cfg(test)]
mod tests {
    use crate::args::{Cli, Command};
    use clap::Parser;

    fn parse(line: &str) -> Result<Command, clap::Error> {
        Cli::try_parse_from(line.split_whitespace()).map(|cli| cli.command)
    }

    #[test]
    fn play_takes_one_of_each() {
        let play = |line: &str| match parse(line).expect(line) {
            Command::Play(args) => *args,
            other => panic!("{other:?}"),
        };
        let args = play("deltamorph play");
        assert_eq!((args.every, args.noise, args.check()), (16, None, Ok(())));
        let args = play("deltamorph play face --weights a.csv --noise 0.001 --every 3 --error-budget 1e-4d");
        assert_eq!((args.every, args.noise, args.check()), (3, Some(0.001), Ok(())));
        let message = play("deltamorph play --path cpu,blocks").check().expect_err("two");
        assert!(message.contains("--path: play takes one"), "{message}");
        assert!(play("deltamorph play --accumulate float,exact").check().is_err());
    }

    #[test]
    fn soak_checks_a_64th() {
        let soak = |line: &str| match parse(line).expect(line) {
            Command::Soak(args) => *args,
            other => panic!("{other:?}"),
        };
        assert_eq!(soak("deltamorph soak --frames 10000000").every(), 156_250);
        assert_eq!(soak("deltamorph soak --frames 5").every(), 1);
        assert_eq!(soak("deltamorph soak --frames 500 --every 100").every(), 100);
        assert!(soak("deltamorph soak --frames 5 --format fast,small").check().is_err());
    }

    #[test]
    fn bad_values_are_refused_with_exit_code_2() {
        for line in [
            "play face --noise 0",
            "play face --noise nan",
            "play face --every 0",
            "play --path gpu",
            "play --batch-size 1..3",
            "soak",
            "soak --frames 0",
            "soak --frames 5 --every 0",
        ] {
            assert_eq!(parse(&format!("deltamorph {line}")).expect_err(line).exit_code(), 2, "{line}");
        }
    }
}
