//! `bench --suite`: ready-made comparisons, each with a page of its own.
//!
//! Configurations of a suite are measured in turns ([`race`](super::race)), and each frame draws every head once behind
//! the update where techniques are compared: what they save in one they may pay for in the other.

mod cells;
mod chapter;
mod crowd;
mod lab;
mod technique;

use super::machine::Machine;
use super::record::Report;
use crate::args::bench::{BenchArgs, SuiteChoice};
use crate::input;
use crate::output::{Failure, Output};
use deltamorph::headless::DeviceChoice;
use lab::Lab;

/// Run the suites that `args` ask for.
pub fn run(args: &BenchArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<Report, Failure> {
    let input = input::load(&args.input, true, out)?;
    let machine = Machine::open(args, device, &input, out)?;
    let empty = machine.report(&input);
    let mut lab = Lab::new(args, &machine, out);
    let asked = |suite| args.suites.contains(&suite) || args.suites.contains(&SuiteChoice::All);
    // Before anything is measured: a set that cannot be used is not to cost what was measured before it.
    let clips = if asked(SuiteChoice::Clips) { cells::captured(&mut lab)? } else { vec![] };
    if asked(SuiteChoice::Chapter) {
        lab.suite("chapter", |lab| chapter::run(lab, input))?;
    }
    if asked(SuiteChoice::Crowd) {
        lab.suite("crowd", crowd::run)?;
    }
    if asked(SuiteChoice::Techniques) {
        lab.suite("techniques", |lab| cells::run(lab, cells::made_up(lab)?, &[1, 10, 100]))?;
    }
    if asked(SuiteChoice::Clips) {
        lab.suite("clips", |lab| cells::run(lab, clips, &[1]))?;
    }
    Ok(lab.report(empty))
}
