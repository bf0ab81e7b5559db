//! Makes a GPU driver compile pipelines, and prints its statistics, in a process of its own whose environment shows
//! only that driver. No GPU is needed: nothing is bound, recorded or run.
//!
//! All output goes to standard error, in lines: some drivers print statistics there while they compile, so the order
//! assigns them to pipelines. `statistics.rs` reads them.

use super::engine::Pipeline;
use crate::prelude::*;
use deltamorph::ash::khr::pipeline_executable_properties::Device as Executables;
use deltamorph::internals::abi::kernels::{Buffer, KernelRow};
use deltamorph::internals::abi::modules::MODULES;
use std::io::{BufRead, Write};
use std::process::{Command, Output, Stdio};

/// Prefix of lines printed by this program.
pub const MARK: &str = "budgets: ";

/// Runs [`compile`] through `launcher`, a command that gets this program and its arguments; returns its output.
pub fn compile_apart(mut launcher: Command, pipelines: &[Pipeline]) -> Output {
    launcher.args(["--exact", "budgets::compiles_what_it_is_told", "--ignored", "--nocapture"]);
    // Variables of ./with-vulkan: only the launcher chooses the driver.
    launcher.env_remove("VK_ADD_DRIVER_FILES").env_remove("VK_INSTANCE_LAYERS");
    launcher.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = launcher.spawn().unwrap_or_else(|e| panic!("{launcher:?}: {e}"));
    let mut input = child.stdin.take().expect("piped");
    let lines = pipelines.iter().map(|(module, constants)| {
        let words = constants.iter().map(|constant| format!(" {constant}"));
        format!("{module}{}\n", words.collect::<String>())
    });
    // If it ends early, its output has the reason.
    let _ = input.write_all(lines.collect::<String>().as_bytes());
    drop(input);
    child.wait_with_output().expect("its output")
}

/// Compiles the pipelines that standard input lists: a module and its specialization constants per line.
pub fn compile() {
    let app = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_1);
    // SAFETY: a device of its own, left to the end of the process: v3dv crashes when it is destroyed.
    unsafe {
        let entry = ash::Entry::load().expect("the Vulkan loader");
        let info = vk::InstanceCreateInfo::default().application_info(&app);
        let instance = entry.create_instance(&info, None).expect("an instance");
        let devices = instance.enumerate_physical_devices().expect("devices");
        let physical = *devices.first().expect("the device that the environment is to show");
        let properties = instance.get_physical_device_properties(physical);
        let queues = [vk::DeviceQueueCreateInfo::default().queue_priorities(&[1.0])];
        let extensions = [ash::khr::pipeline_executable_properties::NAME.as_ptr()];
        let mut feature =
            vk::PhysicalDevicePipelineExecutablePropertiesFeaturesKHR::default().pipeline_executable_info(true);
        let info = vk::DeviceCreateInfo::default()
            .queue_create_infos(&queues)
            .enabled_extension_names(&extensions)
            .push_next(&mut feature);
        let device = instance.create_device(physical, &info, None).expect("a device with statistics of pipelines");
        let version = properties.driver_version;
        let [major, minor, patch] =
            [vk::api_version_major(version), vk::api_version_minor(version), vk::api_version_patch(version)];
        eprintln!("{MARK}driver {major}.{minor}.{patch}");
        eprintln!("{MARK}tuning {:?}", DeviceCaps::query(&instance, physical).expect("its extensions").tuning);
        let executables = Executables::new(&instance, &device);
        for line in std::io::stdin().lock().lines() {
            let line = line.expect("text");
            let mut words = line.split(' ');
            let module = words.next().expect("a module");
            let constants: Vec<u32> = words.map(|word| word.parse().expect("a number")).collect();
            eprintln!("{MARK}pipeline {line}");
            compile_one(&device, &executables, module, &constants);
        }
    }
    eprintln!("{MARK}done");
}

/// # Safety
/// The device is alive, with statistics of pipelines enabled.
unsafe fn compile_one(device: &ash::Device, executables: &Executables, module: &str, constants: &[u32]) {
    let module = MODULES.iter().find(|known| known.name == module).expect("a module of the table");
    let entry = |id| vk::SpecializationMapEntry { constant_id: id, offset: 4 * id, size: 4 };
    let (words, entries): (_, Vec<_>) = (module.words(), (0..constants.len() as u32).map(entry).collect());
    let data: Vec<u8> = constants.iter().flat_map(|constant| constant.to_ne_bytes()).collect();
    let constants = vk::SpecializationInfo::default().map_entries(&entries).data(&data);
    let flags = vk::PipelineCreateFlags::CAPTURE_STATISTICS_KHR;
    // SAFETY: the caller's obligation; the layout is that of the table of kernels, as in the engine. Everything is
    // destroyed once.
    unsafe {
        let (set_layout, layout) = layouts(device, module.kernel);
        let info = vk::ShaderModuleCreateInfo::default().code(&words);
        let raw = device.create_shader_module(&info, None).expect("a module");
        let stage = vk::PipelineShaderStageCreateInfo::default().stage(vk::ShaderStageFlags::COMPUTE).module(raw);
        let stage = stage.name(c"main").specialization_info(&constants);
        let info = vk::ComputePipelineCreateInfo::default().stage(stage).layout(layout).flags(flags);
        let pipeline =
            device.create_compute_pipelines(vk::PipelineCache::null(), &[info], None).expect("a pipeline")[0];
        print_statistics(executables, pipeline);
        device.destroy_pipeline(pipeline, None);
        device.destroy_shader_module(raw, None);
        device.destroy_pipeline_layout(layout, None);
        device.destroy_descriptor_set_layout(set_layout, None);
    }
}

/// # Safety
/// The device is alive.
unsafe fn layouts(device: &ash::Device, kernel: &KernelRow) -> (vk::DescriptorSetLayout, vk::PipelineLayout) {
    let binding = |&(binding, buffer): &(u32, Buffer)| {
        let kind = match buffer {
            Buffer::Storage => vk::DescriptorType::STORAGE_BUFFER,
            Buffer::Dynamic => vk::DescriptorType::STORAGE_BUFFER_DYNAMIC,
            Buffer::UniformTexels(_) => vk::DescriptorType::UNIFORM_TEXEL_BUFFER,
            Buffer::StorageTexels(_) => vk::DescriptorType::STORAGE_TEXEL_BUFFER,
            Buffer::Image => vk::DescriptorType::SAMPLED_IMAGE,
        };
        let layout = vk::DescriptorSetLayoutBinding::default().binding(binding).descriptor_type(kind);
        layout.descriptor_count(1).stage_flags(vk::ShaderStageFlags::COMPUTE)
    };
    let bindings: Vec<_> = kernel.bindings.iter().map(binding).collect();
    let bytes = kernel.push_bytes as usize;
    let push = [vk::PushConstantRange::default().stage_flags(vk::ShaderStageFlags::COMPUTE).size(bytes as u32)];
    // SAFETY: the caller's obligation.
    unsafe {
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        let set = device.create_descriptor_set_layout(&info, None).expect("a layout of a set");
        let sets = [set];
        let info = vk::PipelineLayoutCreateInfo::default()
            .set_layouts(&sets)
            .push_constant_ranges(&push[..usize::from(bytes > 0)]);
        (set, device.create_pipeline_layout(&info, None).expect("a layout"))
    }
}

/// # Safety
/// The pipeline is alive, and was made with `CAPTURE_STATISTICS`.
unsafe fn print_statistics(executables: &Executables, pipeline: vk::Pipeline) {
    let info = vk::PipelineInfoKHR::default().pipeline(pipeline);
    // SAFETY: the caller's obligation.
    let found = unsafe { executables.get_pipeline_executable_properties(&info) }.expect("properties");
    for (i, executable) in (0..).zip(&found) {
        eprintln!("{MARK}Subgroup size = {}", executable.subgroup_size);
        let info = vk::PipelineExecutableInfoKHR::default().pipeline(pipeline).executable_index(i);
        // SAFETY: as above; there is an executable of this index.
        let statistics = unsafe { executables.get_pipeline_executable_statistics(&info) }.expect("statistics");
        for statistic in &statistics {
            use vk::PipelineExecutableStatisticFormatKHR as Format;
            let name = statistic.name_as_c_str().expect("a name").to_string_lossy();
            // SAFETY: the format selects the field.
            let value = unsafe {
                match statistic.format {
                    Format::UINT64 => statistic.value.u64 as f64,
                    Format::INT64 => statistic.value.i64 as f64,
                    Format::FLOAT64 => statistic.value.f64,
                    _ => f64::from(statistic.value.b32),
                }
            };
            eprintln!("{MARK}{name} = {value}");
        }
    }
}
