//! `view`: a window with a slider for each target. Data flows one way: events and scripts become commands, commands
//! change the state, frames are drawn from the state.

mod command;
mod device;
mod hands;
mod painter;
mod panel;
mod plot;
mod sliders;
mod stage;
mod state;
mod style;
mod swapchain;
mod window;

use crate::args::view::ViewArgs;
use crate::input;
use crate::output::{Failure, Output, Result};
use command::Step;
use deltamorph_headless::DeviceChoice;
use std::path::PathBuf;

pub fn run(args: &ViewArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<()> {
    args.run.update.check_single("view").map_err(Failure::Usage)?;
    let mut steps = match &args.script {
        None => vec![],
        Some(path) => {
            let text = std::fs::read_to_string(path).map_err(|e| Failure::io(path, "read", e))?;
            command::script(&text).map_err(|error| Failure::Usage(format!("{}, {error}", path.display())))?
        }
    };
    steps.extend(args.screenshot.iter().map(|path| (0, Step::Screenshot(path.clone()))));
    let written =
        |(_, step): &'_ (usize, Step)| if let Step::Screenshot(path) = step { Some(path.clone()) } else { None };
    let files: Vec<PathBuf> = steps.iter().filter_map(written).collect();
    let mut read = input::files_of(&args.run.input, args.run.weights.as_slice());
    read.extend(args.script.clone());
    out.check(&read, &files.iter().map(PathBuf::as_path).collect::<Vec<_>>(), None)?;
    let scripted = args.script.is_some() || args.screenshot.is_some();
    window::App::new(args, device, out, scripted.then_some(steps))?.run()
}
