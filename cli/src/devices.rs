//! `devices`: what there is, which update paths it can run, and the limits that matter.

use crate::output::{Failure, Output};
use crate::table::{Table, bytes};
use deltamorph::headless::{DeviceChoice, Headless};
use deltamorph::{DeltaFormat, DeviceCaps, UpdatePath, requirements};
use serde::Serialize;

#[derive(Serialize)]
struct Devices {
    schema: u32,
    devices: Vec<Device>,
}

#[derive(Serialize)]
struct Device {
    index: usize,
    name: String,
    kind: &'static str,
    driver: String,
    driver_info: String,
    api_version: String,
    paths: Vec<PathRow>,
    limits: Limits,
}

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

#[derive(Serialize)]
struct Limits {
    storage_range: u64,
    storage_buffers: u32,
    push_constants: u32,
    vertex_attributes: u32,
    vertex_bindings: u32,
    workgroup_invocations: u32,
    allocation: u64,
}

pub fn run(device: Option<&DeviceChoice>, out: &Output) -> Result<(), Failure> {
    out.check(&[], &[], None)?;
    let all = Headless::devices()?;
    let asked = |i: &usize| device.is_none_or(|choice| choice.matches(*i, &all[*i]));
    let devices: Vec<Device> = (0..all.len()).filter(asked).map(|i| describe(i, &all[i])).collect();
    if device.is_some() && devices.is_empty() {
        let there: Vec<String> = all.iter().enumerate().map(|(i, caps)| format!("{i}: {}", caps.name)).collect();
        return Err(Failure::Failed(format!("no such Vulkan device; choose one of: {}", there.join("; "))));
    }
    let devices = Devices { schema: 1, devices };
    out.say(text(&devices));
    out.json(&devices)
}

fn describe(index: usize, caps: &DeviceCaps) -> Device {
    let (major, minor, patch) = caps.api_version;
    Device {
        index,
        name: caps.name.clone(),
        kind: caps.kind.name(),
        driver: caps.driver.clone(),
        driver_info: caps.driver_info.clone(),
        api_version: format!("{major}.{minor}.{patch}"),
        paths: UpdatePath::ALL.into_iter().map(|path| path_row(caps, path)).collect(),
        limits: Limits {
            storage_range: caps.max_storage_range,
            storage_buffers: caps.max_storage_buffers,
            push_constants: caps.max_push_constants,
            vertex_attributes: caps.max_vertex_attributes,
            vertex_bindings: caps.max_vertex_bindings,
            workgroup_invocations: caps.max_workgroup_invocations,
            allocation: caps.max_allocation,
        },
    }
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

fn text(devices: &Devices) -> String {
    if devices.devices.is_empty() {
        return "no Vulkan 1.1 device; the path 'cpu' works without one (./with-vulkan installs lavapipe)".into();
    }
    let mut text = String::new();
    for d in &devices.devices {
        text += &format!(
            "{}: {} ({}), {} {}, Vulkan {}\n",
            d.index, d.name, d.kind, d.driver, d.driver_info, d.api_version
        );
        for p in &d.paths {
            let sizes: Vec<String> = p.batch_max.iter().map(|(f, n)| format!("{n} {f}")).collect();
            text += &match &p.reason {
                Some(reason) => format!("   {}: no: {reason}\n", p.path),
                None if sizes.is_empty() => format!("   {}: yes\n", p.path),
                None => format!("   {}: yes, targets per pass: up to {}\n", p.path, sizes.join(", ")),
            };
        }
        let l = &d.limits;
        let headings = "storage range|storage buffers|push constants|attributes|bindings|invocations|allocation";
        let mut table = Table::new(&headings.split('|').collect::<Vec<_>>(), 0);
        table.row([
            bytes(l.storage_range as f64),
            l.storage_buffers.to_string(),
            format!("{} B", l.push_constants),
            l.vertex_attributes.to_string(),
            l.vertex_bindings.to_string(),
            l.workgroup_invocations.to_string(),
            bytes(l.allocation as f64),
        ]);
        for line in table.to_string().lines() {
            text += &format!("   {line}\n");
        }
    }
    text.truncate(text.trim_end().len());
    text
}
