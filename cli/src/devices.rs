//! `devices`: lists the devices, the update paths that each supports, and the relevant limits.

use crate::output::{Failure, Output, Result};
use crate::table::{Table, bytes};
use deltamorph::{DeltaFormat, DeviceCaps, UpdatePath, requirements};
use deltamorph_headless::{DeviceChoice, Headless};
use serde::Serialize;
use serde_json::{Map, Value, json};

/// An update path of a device, in the JSON of `devices`. Fields may be added, never renamed.
#[derive(Serialize)]
struct PathRow {
    path: &'static str,
    available: bool,
    reason: Option<String>,
    /// Largest batch per delta format.
    batch_max: Vec<(&'static str, u32)>,
    /// Extensions and features that it uses.
    needs: Vec<String>,
}

/// Name in the JSON, heading, value, and format of the value in words.
type Limit = (&'static str, &'static str, fn(&DeviceCaps) -> u64, fn(u64) -> String);

const LIMITS: [Limit; 7] = [
    ("storage_range", "storage range", |caps| caps.max_storage_range, |n| bytes(n as f64)),
    ("storage_buffers", "storage buffers", |caps| caps.max_storage_buffers.into(), |n| n.to_string()),
    ("push_constants", "push constants", |caps| caps.max_push_constants.into(), |n| format!("{n} B")),
    ("vertex_attributes", "attributes", |caps| caps.max_vertex_attributes.into(), |n| n.to_string()),
    ("vertex_bindings", "bindings", |caps| caps.max_vertex_bindings.into(), |n| n.to_string()),
    ("workgroup_invocations", "invocations", |caps| caps.max_workgroup_invocations.into(), |n| n.to_string()),
    ("allocation", "allocation", |caps| caps.max_allocation, |n| bytes(n as f64)),
];

pub fn run(device: Option<&DeviceChoice>, out: &Output) -> Result<()> {
    out.check(&[], &[], None)?;
    let all = Headless::devices()?;
    let chosen = all.iter().enumerate().filter(|(i, caps)| device.is_none_or(|choice| choice.matches(*i, caps)));
    let (texts, devices): (Vec<String>, Vec<_>) = chosen.map(|(i, caps)| describe(i, caps)).unzip();
    if device.is_some() && devices.is_empty() {
        let there: Vec<String> = all.iter().enumerate().map(|(i, caps)| format!("{i}: {}", caps.name)).collect();
        return Err(Failure::Failed(format!("no such Vulkan device; choose one of: {}", there.join("; "))));
    }
    match texts[..] {
        [] => {
            out.say("no Vulkan 1.1 device; the path 'cpu' works without one (on Linux ./with-vulkan installs lavapipe)")
        }
        _ => out.say(texts.join("\n")),
    }
    out.json(&json!({ "schema": 1, "devices": devices }))
}

/// Returns the kind of a device, such as `discrete` or `cpu`.
pub fn kind(caps: &DeviceCaps) -> String {
    let name = format!("{:?}", caps.kind).to_lowercase();
    name.trim_end_matches("_gpu").to_owned()
}

/// Describes a device in words and in JSON.
fn describe(index: usize, caps: &DeviceCaps) -> (String, Value) {
    let DeviceCaps { name, driver, driver_info, api_version: (major, minor, patch), .. } = caps;
    let version = format!("{major}.{minor}.{patch}");
    let kind = kind(caps);
    let paths: Vec<PathRow> = deltamorph_baselines::PATHS.into_iter().map(|path| path_row(caps, path)).collect();
    let mut lines = vec![format!("{index}: {name} ({kind}), {driver} {driver_info}, Vulkan {version}")];
    for PathRow { path, reason, batch_max, .. } in &paths {
        let sizes: Vec<String> = batch_max.iter().map(|(format, n)| format!("{n} {format}")).collect();
        lines.push(match reason {
            Some(reason) => format!("   {path}: no: {reason}"),
            None if sizes.is_empty() => format!("   {path}: yes"),
            None => format!("   {path}: yes, targets per pass: up to {}", sizes.join(", ")),
        });
    }
    let mut table = Table::new(&LIMITS.map(|(_, heading, ..)| heading), 0);
    table.row(LIMITS.map(|(.., value, show)| show(value(caps))));
    lines.extend(table.to_string().lines().map(|line| format!("   {line}")));
    let limits: Map<_, _> = LIMITS.iter().map(|(name, _, value, _)| ((*name).into(), value(caps).into())).collect();
    let device = json!({
        "index": index, "name": name, "kind": kind, "driver": driver, "driver_info": driver_info,
        "api_version": version, "paths": paths, "limits": limits,
    });
    (lines.join("\n"), device)
}

fn path_row(caps: &DeviceCaps, path: UpdatePath) -> PathRow {
    let refused = caps.check_path(path).err();
    let sizes = |format: DeltaFormat| Some((format.name(), caps.batch_max(path, format)?));
    let needs = requirements(path).iter().flat_map(|r| {
        [r.extension.map(|e| e.to_string_lossy().into_owned()), r.feature.map(str::to_owned)].into_iter().flatten()
    });
    PathRow {
        path: path.name(),
        available: refused.is_none(),
        batch_max: if refused.is_none() { DeltaFormat::DENSE.into_iter().filter_map(sizes).collect() } else { vec![] },
        reason: refused.map(|e| e.to_string()),
        needs: needs.collect(),
    }
}
