//! `bench --suite`: ready-made comparisons, each with a page of its own.
//!
//! Configurations of a suite are measured interleaved ([`interleave`](super::interleave)), and each frame draws every
//! head once after the update where techniques are compared: what they save in one they may pay for in the other.

mod cells;
mod chapter;
mod crowd;
mod session;
mod technique;

use super::machine::Machine;
use super::record::Report;
use crate::args::bench::{BenchArgs, SuiteChoice};
use crate::input;
use crate::output::{Failure, Output};
use deltamorph::headless::DeviceChoice;
use session::Session;

/// Run the suites that `args` ask for.
pub fn run(args: &BenchArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<Report, Failure> {
    let input = input::load(&args.input, true, out)?;
    let machine = Machine::open(args, device, &input, out)?;
    let mut session = Session::new(args, &machine, out, machine.report(&input));
    let asked = |suite| args.suites.contains(&suite) || args.suites.contains(&SuiteChoice::All);
    // Before anything is measured: a set that cannot be used is not to cost what was measured before it.
    let clips = if asked(SuiteChoice::Clips) { cells::captured(&mut session)? } else { vec![] };
    if asked(SuiteChoice::Chapter) {
        session.suite("chapter", |session| chapter::run(session, input))?;
    }
    if asked(SuiteChoice::Crowd) {
        session.suite("crowd", crowd::run)?;
    }
    if asked(SuiteChoice::Techniques) {
        session.suite("techniques", |session| cells::run(session, cells::made_up(session)?, &[1, 10, 100]))?;
    }
    if asked(SuiteChoice::Clips) {
        session.suite("clips", |session| cells::run(session, clips, &[1]))?;
    }
    Ok(session.report())
}
