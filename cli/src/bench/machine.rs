//! What a report says about the machine and the mesh.

use super::bandwidth;
use super::record::{Bandwidth, DeviceInfo, Report};
use super::stamp;
use crate::args::bench::BenchArgs;
use crate::input::Input;
use crate::output::{Failure, Output};
use crate::runner::{self, Gpu};
use deltamorph::DeltaFormat;
use deltamorph::headless::{DeviceChoice, Headless};

/// The device, where there is one, and what memory can do.
pub struct Machine {
    pub gpu: Option<Gpu>,
    pub bandwidth: Bandwidth,
    threads: usize,
}

impl Machine {
    /// Set up the device, and measure bandwidth over as many bytes as the deltas of `input` have.
    pub fn open(args: &BenchArgs, device: Option<&DeviceChoice>, input: &Input, out: &Output) -> Result<Self, Failure> {
        let gpu = runner::open(device, out)?;
        if gpu.is_none() {
            out.note("carrying on with the path 'cpu'");
        }
        let threads = args.update.threads.unwrap_or(0);
        let spinner = out.spinner("measuring memory bandwidth");
        let largest = (input.kept.vertex_count() * input.kept.targets.len() * DeltaFormat::Float32.stride()) as u64;
        let (cpu_read_gb_s, cpu_copy_gb_s) = bandwidth::measure(largest, threads).unzip();
        let on_device = gpu.as_ref().map_or(Ok(None), |gpu| gpu.bandwidth(largest.max(1 << 20)))?;
        let (device_copy_gb_s, device_read_gb_s) = on_device.map(|b| (b.copy, b.read)).unzip();
        spinner.finish_and_clear();
        let bandwidth = Bandwidth { cpu_read_gb_s, cpu_copy_gb_s, device_copy_gb_s, device_read_gb_s };
        Ok(Self { gpu, bandwidth, threads })
    }

    /// A report with nothing measured yet.
    pub fn report(&self, input: &Input) -> Report {
        Report {
            schema: 1,
            version: env!("CARGO_PKG_VERSION").into(),
            created: stamp::now(),
            command: stamp::command_line(),
            device: self.device(),
            input: input.info(),
            bandwidth: self.bandwidth,
            ..Report::default()
        }
    }

    fn device(&self) -> DeviceInfo {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let cpu = DeviceInfo {
            name: "none".into(),
            kind: "none".into(),
            cpu: stamp::processor(),
            threads: if self.threads == 0 { cores } else { self.threads },
            ..DeviceInfo::default()
        };
        let Some(caps) = self.gpu.as_ref().map(Gpu::caps) else { return cpu };
        let (major, minor, patch) = caps.api_version;
        let index = Headless::devices().ok().and_then(|all| {
            let key = (&caps.name, &caps.driver, &caps.driver_info);
            all.iter().position(|c| (&c.name, &c.driver, &c.driver_info) == key)
        });
        DeviceInfo {
            name: caps.name.clone(),
            kind: caps.kind.name().into(),
            driver: caps.driver.clone(),
            driver_info: caps.driver_info.clone(),
            api_version: format!("{major}.{minor}.{patch}"),
            index,
            ..cpu
        }
    }
}
