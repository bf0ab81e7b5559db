//! `bench --suite`: ready-made comparisons of techniques. Each frame draws every instance after the update: a technique
//! may save time in one and lose it in the other.

mod scenes;
mod techniques;

use super::record::Report;
use super::session::Session;
use crate::args::bench::{BenchArgs, SuiteChoice};
use crate::input;
use crate::output::{Output, Result};
use deltamorph::PoseFormat::{Fixed16, Float32};
use deltamorph::UpdatePath::{Blocks, Compute};
use deltamorph_baselines::{DIRECT, PATHS};
use deltamorph_headless::DeviceChoice;

/// Seconds to time a configuration for, by default.
const SECONDS: f32 = 5.0;

pub fn run(args: &BenchArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<Report> {
    let input = input::load(&args.input, false, out)?;
    let mut session = Session::open(args, device, &input, SECONDS, out)?;
    let asked = |suite| args.suites.contains(&suite) || args.suites.contains(&SuiteChoice::All);
    // Checked before anything is measured: an unusable clip must not cost earlier measurements.
    let clips = if asked(SuiteChoice::Clips) { scenes::captured(&mut session, input)? } else { vec![] };
    if asked(SuiteChoice::Crowd) {
        let [kept, many] = [scenes::kept(&session)?, scenes::many(&session)?];
        session.suite("crowd", "One head and many");
        techniques::run(&mut session, kept, &[1, 100], &PATHS, &[Float32])?;
        techniques::run(&mut session, many, &[10, 100, 1_000, 10_000], &[Blocks, Compute], &[Fixed16])?;
    }
    if asked(SuiteChoice::Techniques) {
        let made_up = scenes::made_up(&session)?;
        session.suite("techniques", "Every technique, side by side");
        techniques::run(&mut session, made_up, &[1, 10, 100], &PATHS, &[Float32])?;
    }
    if asked(SuiteChoice::Faces) {
        let faces = scenes::faces(&mut session)?;
        session.suite("faces", "A scene of faces of four rigs");
        techniques::run(&mut session, faces, &[40], &[Blocks, Compute, DIRECT], &[Fixed16])?;
    }
    if asked(SuiteChoice::Clips) {
        session.suite("clips", "Every technique on captured clips");
        techniques::run(&mut session, clips, &[1], &PATHS, &[Float32, Fixed16])?;
    }
    Ok(session.report())
}
