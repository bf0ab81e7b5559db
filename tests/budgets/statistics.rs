//! Converts drivers' statistics of pipelines to figures that can be compared.

use super::compiler::MARK;
use super::engine::Pipeline;
use std::collections::HashMap;

/// Figures of a pipeline; `None` if a GPU's driver does not report them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Figures {
    /// Static count: a loop counts once.
    pub instructions: f64,
    /// Registers per lane: VGPRs of AMD, vec4s of Adreno, the most that are live at once of VideoCore.
    pub registers: Option<f64>,
    /// Waves (AMD, Adreno), lanes of a subgroup (Intel) or threads (Mali, VideoCore) that run at once, which registers
    /// limit.
    pub occupancy: f64,
    /// Stores and loads of spilled registers.
    pub spills: f64,
    /// Memory per lane, mostly arrays. Adreno: instructions that access it.
    pub scratch: f64,
    /// Estimated cycles of the limiting unit.
    pub cycles: Option<f64>,
}

/// Statistics by name.
type Statistics = HashMap<String, f64>;

/// The report of a driver.
pub struct Said {
    /// Its version.
    pub driver: String,
    /// The engine's tuning for its device.
    pub tuning: String,
    pub figures: Vec<(Pipeline, Figures)>,
}

/// Parses the output of `compiler::compile` for `gpu`.
///
/// # Errors
/// It ended early, or something is missing; with the last lines of the output.
pub fn parse(gpu: &str, output: &str) -> Result<Said, String> {
    let failed = |why: &str| {
        let lines: Vec<&str> = output.lines().collect();
        format!("{gpu}: {why}; the last lines are\n{}", lines[lines.len().saturating_sub(12)..].join("\n"))
    };
    let (mut driver, mut tuning, mut done, mut found) = (None, None, false, Vec::<(Pipeline, Statistics)>::new());
    for line in output.lines() {
        let ours = line.strip_prefix(MARK);
        if let Some(version) = ours.and_then(|text| text.strip_prefix("driver ")) {
            driver = Some(version.to_owned());
        } else if let Some(text) = ours.and_then(|text| text.strip_prefix("tuning ")) {
            tuning = Some(text.to_owned());
        } else if let Some(pipeline) = ours.and_then(|text| text.strip_prefix("pipeline ")) {
            let mut words = pipeline.split(' ').map(str::to_owned);
            let module = words.next().unwrap_or_default();
            let constants = words.map(|word| word.parse().expect("a number, as we printed it")).collect();
            found.push(((module, constants), Statistics::new()));
        } else if let Some((_, statistics)) = found.last_mut() {
            match ours.and_then(|text| text.split_once(" = ")) {
                Some((name, value)) => _ = statistics.insert(name.to_owned(), value.parse().expect("a number")),
                // Mali and VideoCore: the last of these lines belongs to the driver's final choice.
                None if line.contains("SHADER-DB") => statistics.extend(shader_db(line)),
                None => done |= ours == Some("done"),
            }
        }
    }
    let (driver, tuning) = driver.zip(tuning).ok_or_else(|| failed("no device"))?;
    if !done {
        return Err(failed("it ended early"));
    }
    let figures = found.into_iter().map(|(pipeline, statistics)| {
        let figures = figures(gpu, &statistics).map_err(|name| failed(&format!("no statistic '{name}'")))?;
        Ok((pipeline, figures))
    });
    Ok(Said { driver, tuning, figures: figures.collect::<Result<_, String>>()? })
}

/// Parses `… shader: 100 inst, 30.000000 ls, 2 threads, 0:0 spills:fills`: numbers, then names.
fn shader_db(line: &str) -> Statistics {
    let (_, text) = line.rsplit_once("shader: ").unwrap_or_default();
    let mut statistics = Statistics::new();
    for part in text.split(',') {
        let Some((values, names)) = part.trim().split_once(' ') else { continue };
        for (value, name) in values.split(':').zip(names.split(':')) {
            if let Ok(value) = value.parse() {
                statistics.insert(name.to_owned(), value);
            }
        }
    }
    statistics
}

/// Converts statistics, whose names depend on the vendor. `Err`: a missing name.
fn figures(gpu: &str, statistics: &Statistics) -> Result<Figures, &'static str> {
    let get = |name: &'static str| statistics.get(name).copied().ok_or(name);
    let reported = |name: &'static str| if name.is_empty() { Ok(None) } else { get(name).map(Some) };
    let sum = |names: &[&'static str]| names.iter().try_fold(0.0, |sum, name| get(name).map(|value| sum + value));
    let vendor = gpu.split('-').next().unwrap_or_default();
    // Instructions, registers, occupancy, cycles; then what spills and scratch memory are the sums of.
    let ([instructions, registers, occupancy, cycles], [spills, scratch]): ([_; 4], [&[_]; 2]) = match vendor {
        "amd" => (
            ["Instructions", "VGPRs", "Subgroups per SIMD", "Inverse Throughput"],
            [&["Spilled SGPRs", "Spilled VGPRs"], &["Scratch size"]],
        ),
        "intel" => (
            ["Instruction Count", "", "Subgroup size", "Cycle Count"],
            [&["Spill Count", "Fill Count"], &["Scratch Memory Size"]],
        ),
        // Spills only appear as private memory.
        "adreno" => {
            (["Instruction Count", "Registers used", "Max Waves Per Core", ""], [&[], &["STP Count", "LDP Count"]])
        }
        // Arrays in memory are not counted; the compilers of the others show them.
        "mali" => (["inst", "", "threads", "cycles"], [&["spills", "fills"], &[]]),
        "v3d" => (["inst", "max-temps", "threads", ""], [&["spills", "fills"], &["TMU Spills"]]),
        _ => return Err("of a vendor that statistics.rs does not know"),
    };
    Ok(Figures {
        instructions: get(instructions)?,
        registers: reported(registers)?,
        occupancy: get(occupancy)?,
        spills: sum(spills)?,
        // "TMU Spills" is the size of spills and arrays, not their number: 4 bytes for each of 16 lanes.
        scratch: sum(scratch)? / if vendor == "v3d" { 64.0 } else { 1.0 },
        cycles: reported(cycles)?,
    })
}
