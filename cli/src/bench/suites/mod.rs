//! `bench --suite`: ready-made comparisons, each with its own page. Configurations are measured interleaved. If
//! techniques are compared, each frame draws every instance after the update: a technique may save time in one and
//! lose it in the other.

mod crowd;
mod faces;
mod techniques;

use super::record::Report;
use super::session::Session;
use crate::args::bench::{BenchArgs, SuiteChoice};
use crate::input;
use crate::output::{Failure, Output};
use deltamorph::{PoseFormat, UpdatePath};
use deltamorph_headless::DeviceChoice;

/// Seconds to time a configuration for, by default, in most suites.
const SECONDS: f32 = 5.0;

/// The pose format of most suites.
const FLOAT: [PoseFormat; 1] = [PoseFormat::Float32];

pub fn run(args: &BenchArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<Report, Failure> {
    let input = input::load(&args.input, true, out)?;
    let mut session = Session::open(args, device, &input, out)?;
    let asked = |suite| args.suites.contains(&suite) || args.suites.contains(&SuiteChoice::All);
    // Checked before anything is measured: an unusable data set must not cost earlier measurements.
    let clips = if asked(SuiteChoice::Clips) { techniques::captured(&mut session)? } else { vec![] };
    if asked(SuiteChoice::Crowd) {
        session.suite(["crowd", "One head and many"], SECONDS, crowd::run)?;
    }
    if asked(SuiteChoice::Techniques) {
        let made_up = techniques::made_up(&session)?;
        session.suite(["techniques", "Every technique, side by side"], SECONDS, |session| {
            let all = techniques::all(session, &UpdatePath::ALL, &FLOAT);
            techniques::run(session, made_up, &[1, 10, 100], &all)
        })?;
    }
    if asked(SuiteChoice::Constant) {
        let constant = techniques::constant(&session)?;
        session.suite(["constant", "Constant weights beside animated ones"], 0.5, |session| {
            let poses = [PoseFormat::Float32, PoseFormat::Fixed32];
            let all = techniques::all(session, &UpdatePath::ALL, &poses);
            techniques::run(session, constant, &[1], &all)
        })?;
    }
    if asked(SuiteChoice::Faces) {
        session.suite(["faces", "A scene of faces of four rigs"], SECONDS, faces::run)?;
    }
    if asked(SuiteChoice::Clips) {
        let poses = [PoseFormat::Float32, PoseFormat::Fixed16];
        session.suite(["clips", "Every technique on captured clips"], SECONDS, |session| {
            let all = techniques::all(session, &UpdatePath::ALL, &poses);
            techniques::run(session, clips, &[1], &all)
        })?;
    }
    Ok(session.report())
}
