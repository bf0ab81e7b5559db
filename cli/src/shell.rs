//! `completions` and `man`: what shells and manuals are told of the command line, from its definition.

use crate::args::groups::grouped;
use crate::args::{Cli, CompletionsArgs, ManArgs};
use crate::output::{Failure, Output, create_folder};
use clap::CommandFactory;

pub fn completions(args: &CompletionsArgs, out: &Output) {
    let mut script = vec![];
    clap_complete::generate(args.shell, &mut grouped(Cli::command()), "deltamorph", &mut script);
    out.pass_on(&String::from_utf8_lossy(&script));
}

pub fn man(args: &ManArgs, out: &Output) -> Result<(), Failure> {
    create_folder(&args.dir)?;
    clap_mangen::generate_to(grouped(Cli::command()), &args.dir).map_err(|e| Failure::io(&args.dir, "write", e))?;
    out.say(format_args!("{}: deltamorph.1, and a page for each command", args.dir.display()));
    Ok(())
}
