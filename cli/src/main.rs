//! The command line program: `deltamorph --help`.

mod apply;
mod args;
mod bench;
mod devices;
mod info;
mod input;
mod lod;
mod output;
mod pack;
mod play;
mod progress;
mod render;
mod runner;
mod sample;
mod soak;
mod table;
mod verify;
#[cfg(feature = "viewer")]
mod view;

use args::{Cli, Command};
use clap::Parser;
use output::{Failure, Output, Result};
use std::io::Write;
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = Cli::parse_from(args::with_whole_settings(std::env::args_os()));
    table::fit_terminal();
    #[cfg(unix)]
    clean_up_if_interrupted();
    let out = Output::new(cli.global.quiet, cli.global.json.clone());
    match run(&cli, &out).and_then(|()| out.finish()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            let _ = writeln!(std::io::stderr(), "error: {failure}");
            ExitCode::from(if matches!(failure, Failure::Usage(_)) { 2 } else { 1 })
        }
    }
}

/// Has an interrupted run remove what it has written of files that are not complete. On Windows they stay.
#[cfg(unix)]
fn clean_up_if_interrupted() {
    use deltamorph::internals::unfinished;
    use signal_hook::consts::TERM_SIGNALS;
    use signal_hook::iterator::Signals;
    use signal_hook::low_level::emulate_default_handler;
    use std::fs::{remove_dir_all, remove_file};

    let Ok(mut signals) = Signals::new(TERM_SIGNALS) else { return };
    std::thread::spawn(move || {
        for signal in &mut signals {
            // Held to the end: nothing more is begun.
            let paths = unfinished();
            paths.iter().for_each(|path| drop(remove_file(path).or_else(|_| remove_dir_all(path))));
            let _ = emulate_default_handler(signal);
        }
    });
}

fn run(cli: &Cli, out: &Output) -> Result<()> {
    let device = cli.global.device.as_ref();
    match &cli.command {
        Command::Devices => devices::run(device, out),
        Command::Sample(args) => sample::run(args, out),
        Command::Pack(args) => pack::run(args, out),
        Command::Info(args) => info::run(args, out),
        Command::Bench(args) => bench::run(args, device, out),
        Command::Play(args) => play::run(args, device, out),
        Command::Soak(args) => soak::run(args, device, out),
        Command::Apply(args) => apply::run(args, device, out),
        Command::Render(args) => render::run(args, device, out),
        #[cfg(feature = "viewer")]
        Command::View(args) => view::run(args, device, out),
        #[cfg(not(feature = "viewer"))]
        Command::View(_) => output::refuse(
            "view: this program was built without the window; build it with `cargo build --release --features viewer`",
        ),
        Command::Lod(args) => lod::run(args, device, out),
    }
}
