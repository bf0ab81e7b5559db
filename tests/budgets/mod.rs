//! Limits of kernels: what GPU compilers say of every compute pipeline that the engine makes; no GPU is needed.
//!
//! A change that loses occupancy, spills or keeps more in memory than limits.csv allows fails. AMD's compiler is in the
//! package mesa-vulkan-drivers, and these tests use it. The others are built by a tool that `.ci/budgets` gets.

mod compiler;
mod engine;
mod limits;
mod statistics;

use deltamorph::internals::abi::kernels::Stage;
use deltamorph::internals::abi::modules::{MODULES, Module};
use deltamorph::internals::gpu::tuning::{DeviceClass, DeviceTuning};
use engine::Pipeline;
use limits::{Limits, Row, Table};
use spirq::prelude::*;
use statistics::{Figures, Said};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

/// AMD GPUs by their driver names, which select the pretended GPU; Mesa 25 has another name for the last.
const AMD: [&[&str]; 4] = [&["polaris10"], &["raven"], &["navi21"], &["gfx1100", "navi31"]];

/// Returns the tuning of a GPU, by its name in the table: vendor, and smallest subgroup; compared with the driver's.
fn tuning(gpu: &str) -> DeviceTuning {
    let (vendor, narrowest) = match gpu.split_once('-').unwrap_or_default() {
        ("adreno", _) => (0x5143, 64),
        ("mali", _) => (0x13b5, 4),
        ("v3d", _) => (0x14e4, 16),
        ("intel", _) => (0x8086, 8),
        (_, "polaris10" | "raven") => (0x1002, 64),
        _ => (0x1002, 32),
    };
    DeviceClass::of_vendor(vendor).tuning().for_gpu(vendor, narrowest)
}

/// Names specialization constants as the shader does.
fn named(module: &str, constants: &[u32]) -> String {
    let file = Path::new(env!("OUT_DIR")).join(format!("{module}.spv"));
    let code = std::fs::read(&file).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
    let words: Vec<u32> = code.chunks_exact(4).map(|w| u32::from_le_bytes(w.try_into().unwrap())).collect();
    let reflected = ReflectConfig::new().spv(words).ref_all_rscs(true).reflect().expect("a module");
    let name = |id: u32| {
        let mut names = reflected[0].vars.iter().filter_map(|variable| match variable {
            Variable::SpecConstant { spec_id, name, .. } if *spec_id == id => name.clone(),
            _ => None,
        });
        // The workgroup size has no name.
        names.next().unwrap_or_else(|| if id == 0 { "LANES".into() } else { id.to_string() })
    };
    let words = (0..).zip(constants).map(|(id, value)| format!("{} {value}", name(id)));
    words.collect::<Vec<_>>().join(" ")
}

/// Collects the statistics of the pipelines for a GPU, from the first of `launchers` that works.
fn collected(gpu: &str, launchers: impl IntoIterator<Item = Command>) -> Result<Table, String> {
    let pipelines: Vec<Pipeline> = engine::pipelines(tuning(gpu));
    let parsed = launchers.into_iter().map(|launcher| {
        let output = compiler::compile_apart(launcher, &pipelines);
        statistics::parse(gpu, &String::from_utf8_lossy(&output.stderr))
    });
    let Said { driver, tuning: asked, figures } =
        parsed.reduce(|first, second| first.or(second)).expect("a launcher")?;
    assert_eq!(asked, format!("{:?}", tuning(gpu)), "{gpu}: main.rs, and what the engine makes of the driver");
    let row = |((module, constants), figures): (Pipeline, _)| Row {
        constants: named(&module, &constants),
        kernel: module,
        figures,
    };
    Ok(Table { gpu: gpu.to_owned(), driver, rows: figures.into_iter().map(row).collect() })
}

/// Prints the figures, and compares them with the limits.
fn check(tables: &[Table]) {
    let mut breaches = vec![];
    for table in tables {
        println!("{} (driver {}): instructions / registers / occupancy / cycles", table.gpu, table.driver);
        for Row { kernel, constants, figures } in &table.rows {
            let Figures { instructions, registers, occupancy, cycles, .. } = *figures;
            let told = [Some(instructions), registers, Some(occupancy), cycles].into_iter().flatten();
            let told: Vec<String> = told.map(|figure| format!("{}", (figure * 10.0).round() / 10.0)).collect();
            println!("  {kernel} {constants}: {}", told.join(" / "));
        }
        breaches.extend(Limits::read().breaches(table));
    }
    let what = "Mend the kernel, or give its family a row with a reason in tests/budgets/limits.csv.";
    assert!(breaches.is_empty(), "{}\n{what}", breaches.join("\n"));
}

/// Makes a command with RADV pretending to have this GPU.
fn radv(family: &str) -> Command {
    let folders =
        ["/etc", "/usr/local/etc", "/usr/local/share", "/usr/share"].map(|f| PathBuf::from(f).join("vulkan/icd.d"));
    let names = [format!("radeon_icd.{}.json", std::env::consts::ARCH), "radeon_icd.json".to_owned()];
    let manifests = folders.iter().flat_map(|folder| names.iter().map(|name| folder.join(name)));
    let manifest = manifests.into_iter().find(|manifest| manifest.exists());
    let manifest = manifest.unwrap_or_else(|| {
        panic!(
            "AMD's driver RADV is missing: no {} in {folders:?}; install mesa-vulkan-drivers (Debian, Fedora) or \
             vulkan-radeon (Arch)",
            names.join(" or ")
        )
    });
    let mut command = Command::new(std::env::current_exe().expect("a path to this test"));
    // Loaders before 1.3.207 know only the second name.
    command.env("VK_DRIVER_FILES", &manifest).env("VK_ICD_FILENAMES", &manifest);
    command.env("RADV_FORCE_FAMILY", family).env("MESA_SHADER_CACHE_DISABLE", "1");
    command
}

#[test]
fn kernels_keep_their_limits_on_amd() {
    let collect = |names: &'static [&'static str]| {
        collected(&format!("amd-{}", names[0]), names.iter().map(|name| radv(name))).unwrap_or_else(|e| {
            panic!(
                "{e}\nRADV of Mesa 20 to 25 pretends to have a GPU where RADV_FORCE_FAMILY says so; is this another? \
                 Then leave this test out by its name: cargo test -- --skip kernels_keep_their_limits_on_amd"
            )
        })
    };
    let tables = std::thread::scope(|scope| {
        AMD.map(|names| scope.spawn(move || collect(names))).map(|thread| thread.join().expect("its panic was printed"))
    });
    check(&tables);
}

/// The tool from `.ci/budgets`: its path and build folder are in the environment.
#[test]
#[ignore = "needs compilers that .ci/budgets gets and tells of"]
fn kernels_keep_their_limits_on_every_gpu() {
    let variable = |name| std::env::var_os(name).unwrap_or_else(|| panic!("{name} is not set: run bash .ci/budgets"));
    let (tool, folder) = (variable("DELTAMORPH_SHADER_STATS"), variable("DELTAMORPH_SHADER_STATS_DIR"));
    let gpus = Command::new(&tool).arg("gpus").arg(&folder).output().expect("the tool starts");
    let gpus = String::from_utf8(gpus.stdout).expect("text");
    let launcher = |gpu| {
        let mut command = Command::new(&tool);
        command.arg("run").arg(&folder).arg(gpu).arg(std::env::current_exe().expect("a path to this test"));
        command
    };
    let tables = gpus.lines().map(|gpu| collected(gpu, [launcher(gpu)]).unwrap_or_else(|e| panic!("{e}")));
    check(&tables.collect::<Vec<_>>());
}

#[test]
#[ignore = "what the others start, for one driver"]
fn compiles_what_it_is_told() {
    compiler::compile();
}

#[test]
fn every_kernel_that_gpus_run_has_a_pipeline_and_every_limit_a_kernel() {
    let (mut made, mut families) = (BTreeSet::new(), BTreeSet::new());
    for gpu in ["adreno-610", "intel-skl"] {
        for (kernel, constants) in engine::pipelines(tuning(gpu)) {
            let row = Row { constants: named(&kernel, &constants), kernel, figures: Figures::default() };
            families.insert(row.family());
            made.insert(row.kernel);
        }
    }
    // Texels and a planner are for software drivers; `read` measures bandwidth.
    let others = ["crowd_texels", "plan", "read"];
    let draws = [Stage::Vertex, Stage::Fragment];
    let ours = |module: &&Module| !draws.contains(&module.kernel.stage) && !others.contains(&module.kernel.name);
    let all: BTreeSet<String> = MODULES.iter().filter(ours).map(|module| module.name.to_owned()).collect();
    assert_eq!(made, all, "engine.rs makes crowds of every kind; is there a new one?");
    assert_eq!(Limits::read().without_kernel(&families), <[&str; 0]>::default(), "limits.csv");
}
