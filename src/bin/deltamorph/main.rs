//! The command line program: `deltamorph --help`.

mod args;
mod bench;
mod info;
mod input;
mod output;
mod sample;
mod table;

use args::{Cli, Command};
use clap::Parser;
use output::{Failure, Output};
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = Cli::parse();
    let out = Output::new(&cli.global);
    match run(&cli, &out) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("error: {failure}");
            failure.exit_code()
        }
    }
}

fn run(cli: &Cli, out: &Output) -> Result<(), Failure> {
    match &cli.command {
        Command::Devices => Err(Failure::missing("devices")),
        Command::Sample(args) => sample::run(args, out),
        Command::Info(args) => info::run(args, out),
        Command::Bench(args) => bench::run(args, out),
        Command::Apply(args) => {
            args.check().map_err(Failure::Usage)?;
            Err(Failure::missing("apply"))
        }
    }
}
