//! `replay`: makes the calls that a host logged on a crowd, on any driver, and hashes the poses.

use crate::args::ReplayArgs;
use crate::input;
use crate::output::{Failure, Output};
use crate::runner::{Runner, open, packed};
use deltamorph::UpdatePath;
use deltamorph::calls::{Call, Calls};
use deltamorph_headless::DeviceChoice;
use serde_json::json;
use std::slice::from_ref;

pub fn run(args: &ReplayArgs, device: Option<&DeviceChoice>, out: &Output) -> Result<(), Failure> {
    out.check(&input::files_of(&args.input, from_ref(&args.calls)), &[], None)?;
    let calls = Calls::read(&args.calls)?;
    let update = calls.update.path(args.path.unwrap_or(calls.update.path));
    let input = input::load(&args.input, false, out)?;
    let gpu = if update.path == UpdatePath::Cpu { None } else { open(device, out)? };
    let mesh = packed(&input, gpu.as_ref().map(|gpu| gpu.engine()), calls.format, &args.pack)?;
    calls.check(mesh.layout())?;
    let mut runner = Runner::new(gpu.as_ref(), &mesh, update, calls.instances, 0)?;
    let bar = out.bar(calls.calls.len() as u64);
    for call in &calls.calls {
        runner.repeat(call)?;
        bar.inc(1);
    }
    drop(bar);
    let updates = calls.calls.iter().filter(|call| **call == Call::Update).count();
    let (hash, poses) = runner.hash(update.pose)?;
    let device = gpu.as_ref().map_or("the processor", |gpu| &gpu.caps().name);
    let (path, pose) = (update.path.name(), update.pose.name());
    out.say(format_args!(
        "{updates} updates of {} instances through {path} on {device}; hash {hash:016x} of {poses} {pose} poses",
        calls.instances
    ));
    let hash = format!("{hash:016x}");
    out.json(&json!({
        "schema": 1, "calls": args.calls, "input": input.origin, "device": device, "path": path, "pose": pose,
        "updates": updates, "instances": calls.instances, "poses": poses, "poses_hash": hash,
    }))
}
