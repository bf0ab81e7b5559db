//! The real drivers that every GPU test runs on, with the validation layers on.

use crate::hazards::{Event, HazardChecker, Violation, accesses, trace};
use deltamorph::after::{GpuNormals, GpuSkin, SkinDesc};
use deltamorph::internals::pack::PackedGroup;
use deltamorph::internals::plan::schedule::{Barrier, Entry, asset_uploaded};
use deltamorph::mesh::{Corner, Faces};
use deltamorph::packed::PoseGrid;
use deltamorph::reference::{compare, evaluate_group};
use deltamorph::{
    BatchSize, CpuCrowd, CrowdDesc, DeltaFormat, DeviceCaps, GpuMesh, KeptMesh, MorphEngine, POSE_FLOATS, PackDesc,
    PackedMesh, PoseError, PoseFormat, Result, UpdateDesc, UpdatePath, WeightClip,
};
use deltamorph_headless::{DeviceChoice, Headless, HeadlessCrowd, HeadlessDesc, Step};
use std::collections::BTreeSet;
use std::slice::from_mut;
use std::sync::Arc;

/// The project's error limits after whole clips: positions, as a fraction of the diagonal…
pub const POSITION: f64 = 3e-6;
/// … and normals, in degrees.
pub const NORMAL: f64 = 0.01;

/// Packs `mesh` for the device.
pub fn packed(engine: &MorphEngine, mesh: &KeptMesh, format: DeltaFormat) -> PackedMesh {
    PackedMesh::pack(mesh, &engine.pack_desc(format)).expect("a mesh that fits")
}

/// Uploads `mesh`, waits, and releases its staging memory.
pub fn upload(headless: &Headless, engine: &MorphEngine, mesh: &PackedMesh) -> GpuMesh {
    // SAFETY: `upload` hands out a recording buffer of the engine's device, and waits.
    headless.upload(|cmd| unsafe { engine.upload(cmd, mesh) }).expect("an upload")
}

/// Uploads a skin, waits, and releases its staging memory.
pub fn skin(headless: &Headless, mesh: &PackedMesh, desc: &SkinDesc<'_>) -> Result<GpuSkin> {
    // SAFETY: `run` hands out a recording buffer of the engine's device, and waits; so below.
    let mut skin = headless.run(|cmd| unsafe { headless.engine().upload_skin(cmd, mesh, desc) })?;
    skin.release_staging();
    Ok(skin)
}

/// Uploads a surface for normals, waits, and releases its staging memory.
pub fn surface(headless: &Headless, mesh: &PackedMesh) -> Result<GpuNormals> {
    // SAFETY: as above.
    let mut surface = headless.run(|cmd| unsafe { headless.engine().upload_normals(cmd, mesh) })?;
    surface.release_staging();
    Ok(surface)
}

/// Returns faces of these sizes with these vertices at their corners.
pub fn faces(sizes: &[u32], vertices: &[u32]) -> Faces {
    let corners = vertices.iter().map(|&position| Corner { position, texcoord: None });
    Faces { sizes: sizes.to_vec(), corners: corners.collect() }
}

/// Returns a clip that animates all targets of `mesh`.
pub fn clip(mesh: &PackedMesh, fps: f32, values: Vec<f32>) -> WeightClip {
    let names = mesh.layout().targets.iter().map(|target| target.name.clone()).collect();
    WeightClip { name: "clip".into(), names, fps, values, notes: vec![] }
}

pub fn bits(numbers: &[f32]) -> Vec<u32> {
    numbers.iter().map(|x| x.to_bits()).collect()
}

/// Returns whether `error` is within the project's limits, for a mesh of `diagonal`.
pub fn is_kept(error: &PoseError, diagonal: f32) -> bool {
    error.within(POSITION * f64::from(diagonal), NORMAL)
}

/// Returns `default`, or the list in `DELTAMORPH_TEST_DRIVERS`: parts of the names of required devices.
pub fn drivers_or(default: &str) -> Vec<String> {
    let list = std::env::var("DELTAMORPH_TEST_DRIVERS").unwrap_or_else(|_| default.into());
    list.split(',').map(str::to_owned).collect()
}

/// Returns parts of the names of the devices that tests run on.
pub fn drivers() -> Vec<String> {
    drivers_or("llvmpipe")
}

/// Returns the first of `drivers`, for what is the same on every driver.
pub fn one() -> String {
    drivers().swap_remove(0)
}

/// Whether every combination runs on a device: on those of [`drivers`]. SwiftShader is one if `DELTAMORPH_TEST_DRIVERS`
/// names it, as `.ci/deep` does. Others compile a pipeline for a second.
pub fn runs_all(headless: &Headless) -> bool {
    drivers().iter().any(|driver| headless.caps().name.contains(driver))
}

/// Returns all kinds of updates that a device supports and that leave a pose on it, each with a delta format.
pub fn updates(headless: &Headless) -> Vec<(DeltaFormat, UpdateDesc)> {
    let blocks = |format, pose| (format, UpdateDesc { pose, ..UpdateDesc::blocks() });
    let dense = |path| (DeltaFormat::Float32, UpdateDesc::new(path, BatchSize::Targets(3)));
    let mut all = vec![
        blocks(DeltaFormat::Fast, PoseFormat::Float32),
        blocks(DeltaFormat::Fast, PoseFormat::Fixed32),
        blocks(DeltaFormat::Small, PoseFormat::Fixed16),
        dense(UpdatePath::Compute),
        dense(UpdatePath::Feedback),
    ];
    all.retain(|(_, update)| headless.caps().check_path(update.path).is_ok());
    all
}

/// Runs `test` on the drivers of all tests unchanged, and on the first also clamped to the Android baseline. A missing
/// driver fails, and so does every message of the validation layers.
pub fn on_every_device(test: impl Fn(&Headless, &MorphEngine)) {
    on(&drivers(), test);
}

/// The same on SwiftShader, too, which takes a second to compile a pipeline: for the few tests that together run each
/// kernel of poses once.
pub fn on_every_driver(test: impl Fn(&Headless, &MorphEngine)) {
    on(&drivers_or("llvmpipe,SwiftShader"), test);
}

/// The baseline changes plans and recordings, which one driver shows; tests of limits name the limits they need.
fn on(drivers: &[String], test: impl Fn(&Headless, &MorphEngine)) {
    for (index, driver) in drivers.iter().enumerate() {
        on_device(driver, false, &test);
        if index == 0 {
            on_device(driver, true, &test);
        }
    }
}

/// Returns the capabilities of a driver.
pub fn caps(driver: &str) -> DeviceCaps {
    let found = Headless::devices().ok().and_then(|all| all.into_iter().find(|caps| caps.name.contains(driver)));
    found.unwrap_or_else(|| panic!("{driver} is missing\nrun the tests as ./with-vulkan cargo test"))
}

/// Returns `caps`, changed.
pub fn limited(mut caps: DeviceCaps, change: impl FnOnce(&mut DeviceCaps)) -> DeviceCaps {
    change(&mut caps);
    caps
}

/// Returns the Android baseline, changed.
pub fn baseline(change: impl FnOnce(&mut DeviceCaps)) -> DeviceCaps {
    limited(DeviceCaps::android_baseline(), change)
}

/// Returns `limits` without and with texel buffers and 64-bit integers, for every driver.
pub fn with_and_without_texels(limits: &DeviceCaps) -> Vec<(String, DeviceCaps)> {
    let roomy = limited(limits.clone(), |caps| (caps.max_texels, caps.int64) = (u32::MAX, true));
    drivers().into_iter().flat_map(|driver| [(driver.clone(), roomy.clone()), (driver, limits.clone())]).collect()
}

/// Opens a device whose name contains `driver`.
pub fn device(driver: &str, validation: bool, limits: Option<DeviceCaps>) -> Headless {
    let desc = HeadlessDesc { device: DeviceChoice::Name(driver.to_owned()), ..Default::default() };
    let headless = Headless::new(&HeadlessDesc { validation, limits, ..desc })
        .unwrap_or_else(|e| panic!("{driver}: {e}\nrun the tests as ./with-vulkan cargo test"));
    headless.engine().set_techniques(&deltamorph_baselines::TECHNIQUES);
    headless
}

/// Runs `test` on one device.
pub fn on_device<R>(driver: &str, android_baseline: bool, test: impl FnOnce(&Headless, &MorphEngine) -> R) -> R {
    let limits = android_baseline.then(DeviceCaps::android_baseline);
    on_device_within(driver, limits, test)
}

/// Runs `test` on one device within limits.
pub fn on_device_within<R>(
    driver: &str,
    limits: Option<DeviceCaps>,
    test: impl FnOnce(&Headless, &MorphEngine) -> R,
) -> R {
    let headless = device(driver, true, limits);
    let result = test(&headless, headless.engine());
    let caps = headless.caps();
    let messages = complaints(&headless);
    assert!(messages.is_empty(), "{} ({}) says:\n{}", caps.name, caps.driver, messages.join("\n"));
    result
}

/// Returns the messages of the validation layers, without known false ones.
///
/// Layers of 1.4.363 report two dispatches that write one buffer without a barrier between them. They track a dispatch
/// by whole descriptors, but these dispatches write different instances, chunks or blocks. `HazardChecker` tracks
/// those, and rejects two that write the same place. A missing barrier also causes a read after a write, which is kept.
pub fn complaints(headless: &Headless) -> Vec<String> {
    let disjoint = |m: &String| {
        m.contains("SYNC-HAZARD-WRITE-AFTER-WRITE") && m.contains("previously written by another vkCmdDispatch")
    };
    headless.messages().into_iter().filter(|message| !disjoint(message)).collect()
}

/// Asserts that synchronization validation of lavapipe reports a missing barrier of an update: `make` makes a crowd
/// that has shown a pose, `leave_out` selects the barrier.
pub fn assert_validation_sees_dropped(
    what: &str,
    weights: &[&[f32]],
    mut leave_out: impl FnMut(&Barrier) -> bool,
    make: impl for<'a> FnOnce(&'a Headless) -> HeadlessCrowd<'a>,
) {
    let headless = device("llvmpipe", true, None);
    let mut crowd = make(&headless);
    assert_eq!(complaints(&headless), Vec::<String>::new());
    let drop_one = |entries: &mut Vec<Entry>| {
        let at = entries.iter().position(|entry| matches!(entry, Entry::Barrier(barrier) if leave_out(barrier)));
        entries.remove(at.expect("such a barrier"));
    };
    // SAFETY: a barrier less; the driver is a software one, which runs commands in order.
    unsafe { HeadlessCrowd::step_tampered(from_mut(&mut crowd), weights, drop_one) }.expect("a step");
    let messages = complaints(&headless);
    assert!(messages.iter().any(|m| m.contains("SYNC-HAZARD")), "{what}: {messages:?}");
}

/// Returns every path with several batch sizes that the device supports for `format`.
pub fn update_descs(engine: &MorphEngine, format: DeltaFormat) -> Vec<UpdateDesc> {
    let mut descs = vec![];
    if format.is_blocks() {
        descs.push(UpdateDesc { tolerance: 1e-2, ..UpdateDesc::blocks() });
        descs.extend(fixed());
        return descs;
    }
    for path in [UpdatePath::Feedback, UpdatePath::Compute, deltamorph_baselines::VERTEX_STORE] {
        if engine.caps().check_path(path).is_err() {
            continue;
        }
        let most = engine.caps().batch_max(path, format).expect("a GPU path has a largest batch");
        let sizes = BTreeSet::from([1, 2, 3, 7, most / 2, most]).into_iter().filter(|size| (1..=most).contains(size));
        descs.extend(sizes.map(|size| UpdateDesc::new(path, BatchSize::Targets(size))));
        if path == UpdatePath::Compute {
            descs.push(UpdateDesc::new(path, BatchSize::All));
        }
    }
    descs
}

/// Returns updates with fixed-point poses, in each format, that can hold the [`weights`].
pub fn fixed() -> [UpdateDesc; 3] {
    let desc = UpdateDesc { weight_max: Some(4.0), ..UpdateDesc::blocks() };
    [PoseFormat::Fixed32, PoseFormat::Fixed16, PoseFormat::Rebuilt16].map(|pose| UpdateDesc { pose, ..desc })
}

/// Returns the integers that poses on `grid` hold for `weights`, in the user's vertex order: the base pose and exact
/// products in float64, each rounded to the unit, or their sum.
pub fn integers(group: &PackedGroup, grid: &PoseGrid, weights: &[f32]) -> Vec<f64> {
    let mut sums: Vec<f64> = group.layout().to_user_order(group.base()).into_iter().map(f64::from).collect();
    for (i, sum) in sums.iter_mut().enumerate() {
        let c = i % POSE_FLOATS;
        let unit = f64::from(grid.units[c]);
        // Where sums are rounded, the base pose is in 2^-16 of units.
        let own = if grid.rounds_sums { unit / 65536.0 } else { unit };
        *sum = ((*sum - f64::from(grid.offsets[c])) / own).round() * own / unit;
    }
    for (target, &weight) in weights.iter().enumerate().filter(|(_, w)| **w != 0.0) {
        let weight = f64::from(grid.round(weight));
        group.for_each_delta(target, |vertex, delta| {
            for (c, delta) in delta.into_iter().enumerate() {
                let term = weight * delta / f64::from(grid.units[c]);
                sums[vertex * POSE_FLOATS + c] += if grid.rounds_sums { term } else { (term + 0.5).floor() };
            }
        });
    }
    // Sums of products of integers and powers of two are exact.
    sums.into_iter().map(|sum| if grid.rounds_sums { (sum + 0.5).floor() } else { sum }).collect()
}

/// Asserts that a stored pose has the [`integers`] of `weights`, vertex by vertex.
pub fn assert_integers(group: &PackedGroup, desc: &UpdateDesc, stored: &[u8], weights: &[f32]) {
    let grid = desc.grid(group.layout()).expect("a grid").expect("poses of integers");
    let (sums, numbers) = (integers(group, &grid, weights), desc.pose.integers(stored));
    for (packed, numbers) in numbers.as_chunks::<POSE_FLOATS>().0.iter().enumerate() {
        let Some(vertex) = group.layout().user_vertex(packed) else { continue };
        let expected = &sums[vertex * POSE_FLOATS..][..POSE_FLOATS];
        let (numbers, same) = (numbers.map(f64::from), |(a, b): (&f64, &f64)| a == b);
        assert!(numbers.iter().zip(expected).all(same), "{desc:?}, vertex {vertex}: {numbers:?}, not {expected:?}");
    }
}

/// Returns the reference for poses of `desc`: full evaluation in float64, on the fixed-point grid if it has one.
pub fn reference(mesh: &PackedMesh, desc: &UpdateDesc, weights: &[f32]) -> Vec<f64> {
    reference_group(&mesh.groups()[0], desc, weights)
}

/// Returns the [`reference`] of a group.
pub fn reference_group(group: &PackedGroup, desc: &UpdateDesc, weights: &[f32]) -> Vec<f64> {
    let Some(grid) = desc.grid(group.layout()).expect("a grid for this mesh") else {
        return evaluate_group(group, weights);
    };
    let numbers = integers(group, &grid, weights).into_iter().enumerate();
    let value = |c: usize, number: f64| f64::from(grid.offsets[c]) + number * f64::from(grid.units[c]);
    numbers.map(|(i, number)| value(i % POSE_FLOATS, number)).collect()
}

/// Makes a crowd of one instance.
pub fn crowd<'a>(headless: &'a Headless, mesh: &PackedMesh, update: UpdateDesc) -> HeadlessCrowd<'a> {
    HeadlessCrowd::new(headless, mesh, &CrowdDesc::new(update)).expect("a crowd")
}

/// Makes a crowd on the CPU with the updates of another path, on two threads.
pub fn cpu_crowd(mesh: &Arc<PackedMesh>, update: UpdateDesc, instances: u32) -> CpuCrowd {
    let desc = CrowdDesc { instances, ..CrowdDesc::new(UpdateDesc { path: UpdatePath::Cpu, ..update }) };
    CpuCrowd::new(mesh.clone(), &desc, 2).expect("a crowd")
}

/// Returns the error of an instance's pose against the reference.
pub fn error(crowd: &mut HeadlessCrowd<'_>, instance: u32, mesh: &PackedMesh, weights: &[f32]) -> PoseError {
    let update = crowd.crowd().desc().update;
    compare(&crowd.read_pose(instance).expect("a pose"), &reference(mesh, &update, weights))
}

/// Asserts that an instance's pose is within the project's limits.
pub fn assert_right(crowd: &mut HeadlessCrowd<'_>, instance: u32, mesh: &PackedMesh, weights: &[f32]) {
    let error = error(crowd, instance, mesh, weights);
    let desc = crowd.crowd().desc();
    assert!(is_kept(&error, mesh.layout().diagonal), "{:?}, {desc:?}, {instance}: {error:?}", mesh.layout().format);
}

/// Steps a crowd; also returns the recording as the hazard checker sees it.
pub fn recorded(crowd: &mut HeadlessCrowd<'_>, weights: &[&[f32]]) -> (Step, Vec<Entry>, Vec<Event>) {
    let mut list = vec![];
    // SAFETY: nothing is changed.
    let step = unsafe { HeadlessCrowd::step_tampered(from_mut(crowd), weights, |entries| list.clone_from(entries)) };
    let events = trace(&list, |_, works| accesses(crowd.crowd(), works));
    (step.expect("a step"), list, events)
}

/// Packs `mesh`, of 1000 vertices and 37 targets, for a device whose descriptors cover 128 vertices.
pub fn in_eight_chunks(mesh: &KeptMesh, format: DeltaFormat) -> PackedMesh {
    let max_chunk_bytes = 128 * 37 * format.stride() as u64;
    let desc = PackDesc { max_chunk_bytes, ..PackDesc::new(format) };
    let mesh = PackedMesh::pack(mesh, &desc).expect("a mesh that fits");
    assert_eq!(mesh.layout().chunks().count(), 8);
    mesh
}

/// Returns weights of which some change in each frame: negative, above one, zero.
pub fn weights(mesh: &PackedMesh, frame: u32, seed: u32) -> Vec<f32> {
    (0..mesh.layout().targets.len() as u32)
        .map(|t| {
            // A target holds its weight for a few frames.
            let held = (frame + t * 7) / (1 + t % 4);
            let x = (seed ^ t.wrapping_mul(0x9E37_79B9) ^ held.wrapping_mul(0x85EB_CA6B)).wrapping_mul(0xC2B2_AE35);
            let x = (x ^ (x >> 15)).wrapping_mul(0x2C1B_3C6D) >> 12;
            if x.is_multiple_of(4) { 0.0 } else { (x % 4096) as f32 / 1500.0 - 0.9 }
        })
        .collect()
}

/// Runs the hazard checker over updates of one instance after an upload: each as recorded, with the slot whose groups
/// are drawn after it, if it changed anything.
pub fn hazards(mesh: &PackedMesh, frames: &[(Vec<Event>, u32)]) -> Result<(), Vec<Violation>> {
    let mut checker = HazardChecker::default();
    checker.upload(asset_uploaded());
    for (events, slot) in frames {
        checker.update(events);
        if !events.is_empty() {
            (0..mesh.groups().len() as u32).for_each(|group| checker.draw_group(0, group, 0, *slot));
        }
    }
    checker.finish()
}
