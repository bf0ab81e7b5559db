//! A device whose calls are written down, a line each, before they go to the driver.

use crate::prelude::*;
use std::cell::{Cell, RefCell};
use std::ffi::{CStr, c_char, c_void};
use std::slice::from_raw_parts;

type Function = unsafe extern "system" fn();
type Cmd = vk::CommandBuffer;
type Callbacks<'a> = *const vk::AllocationCallbacks<'a>;

thread_local! {
    static LOG: RefCell<Vec<String>> = const { RefCell::new(vec![]) };
    static REAL: RefCell<HashMap<&'static str, Function>> = RefCell::default();
    static LOOK_UP: Cell<Option<vk::PFN_vkGetDeviceProcAddr>> = const { Cell::new(None) };
}

/// Takes the lines of this thread.
pub fn log() -> Vec<String> {
    LOG.take()
}

/// Returns instance and device of `headless`, for an engine that is used on this thread, and whose calls are written
/// down.
pub fn watched(headless: &Headless) -> (ash::Instance, ash::Device) {
    let (instance, _, device) = headless.handles();
    LOOK_UP.set(Some(instance.fp_v1_0().get_device_proc_addr));
    let functions = ash::InstanceFnV1_0 { get_device_proc_addr: look_up, ..instance.fp_v1_0().clone() };
    let (v1_1, v1_3) = (instance.fp_v1_1().clone(), instance.fp_v1_3().clone());
    let instance = ash::Instance::from_parts_1_3(instance.handle(), functions, v1_1, v1_3);
    // SAFETY: the device is the instance's, and alive.
    let device = unsafe { ash::Device::load(instance.fp_v1_0(), device.handle()) };
    LOG.take();
    (instance, device)
}

/// Functions that write a line and call the driver's, by name; and the function that looks them up.
macro_rules! watched {
    ($($name:ident: $type:ty = |$($argument:ident: $of:ty),*| $(-> $result:ty =>)? $line:expr;)*) => {
        $(
            #[allow(non_snake_case)]
            unsafe extern "system" fn $name($($argument: $of),*) $(-> $result)? {
                // SAFETY: the caller's obligations are those of the driver's function; structures have the counts that
                // they state.
                #[allow(unused_unsafe, reason = "some lines are of numbers alone")]
                let line = unsafe { $line };
                LOG.with_borrow_mut(|log| log.push(line));
                let real = REAL.with_borrow(|real| real[stringify!($name)]);
                // SAFETY: the driver's function of this name, and what it was called with.
                unsafe { std::mem::transmute::<Function, $type>(real)($($argument),*) }
            }
        )*

        /// # Safety
        /// Those of vkGetDeviceProcAddr.
        unsafe extern "system" fn look_up(device: vk::Device, name: *const c_char) -> vk::PFN_vkVoidFunction {
            // SAFETY: the caller's obligations.
            let (name, real) = unsafe { (CStr::from_ptr(name), LOOK_UP.get()?(device, name)?) };
            match name.to_str().ok()? {
                $(stringify!($name) => {
                    REAL.with_borrow_mut(|all| all.insert(stringify!($name), real));
                    // SAFETY: called as its own type.
                    Some(unsafe { std::mem::transmute::<$type, Function>($name) })
                })*
                _ => Some(real),
            }
        }
    };
}

watched! {
    vkAllocateMemory: vk::PFN_vkAllocateMemory = |
        device: vk::Device, info: *const vk::MemoryAllocateInfo<'_>, callbacks: Callbacks<'_>,
        memory: *mut vk::DeviceMemory
    | -> vk::Result => format!("allocate {}", (*info).allocation_size);
    vkFreeMemory: vk::PFN_vkFreeMemory = |
        device: vk::Device, memory: vk::DeviceMemory, callbacks: Callbacks<'_>
    | "free".to_owned();
    vkCreateBuffer: vk::PFN_vkCreateBuffer = |
        device: vk::Device, info: *const vk::BufferCreateInfo<'_>, callbacks: Callbacks<'_>, buffer: *mut vk::Buffer
    | -> vk::Result => format!("buffer {}", (*info).size);
    vkCreateDescriptorSetLayout: vk::PFN_vkCreateDescriptorSetLayout = |
        device: vk::Device, info: *const vk::DescriptorSetLayoutCreateInfo<'_>, callbacks: Callbacks<'_>,
        layout: *mut vk::DescriptorSetLayout
    | -> vk::Result => {
        let bindings = from_raw_parts((*info).p_bindings, (*info).binding_count as usize);
        let buffers = bindings.iter().filter(|binding| is_storage_buffer(binding.descriptor_type));
        format!("set {}", buffers.map(|binding| binding.descriptor_count).sum::<u32>())
    };
    vkUpdateDescriptorSets: vk::PFN_vkUpdateDescriptorSets = |
        device: vk::Device, count: u32, writes: *const vk::WriteDescriptorSet<'_>, copies: u32,
        copied: *const vk::CopyDescriptorSet<'_>
    | {
        let writes = from_raw_parts(writes, count as usize).iter();
        let writes = writes.filter(|write| is_storage_buffer(write.descriptor_type));
        let infos = writes.flat_map(|write| from_raw_parts(write.p_buffer_info, write.descriptor_count as usize));
        infos.fold("descriptors".to_owned(), |line, info| format!("{line} {} {}", info.offset, info.range))
    };
    vkCreateShaderModule: vk::PFN_vkCreateShaderModule = |
        device: vk::Device, info: *const vk::ShaderModuleCreateInfo<'_>, callbacks: Callbacks<'_>,
        module: *mut vk::ShaderModule
    | -> vk::Result => format!("module {:x}", hash(from_raw_parts((*info).p_code, (*info).code_size / 4)));
    vkCreateComputePipelines: vk::PFN_vkCreateComputePipelines = |
        device: vk::Device, cache: vk::PipelineCache, count: u32, infos: *const vk::ComputePipelineCreateInfo<'_>,
        callbacks: Callbacks<'_>, pipelines: *mut vk::Pipeline
    | -> vk::Result => {
        let infos = from_raw_parts(infos, count as usize).iter();
        infos.fold(format!("pipelines of {cache:?}"), |line, info| line + ":" + &constants(&info.stage))
    };
    vkCreateGraphicsPipelines: vk::PFN_vkCreateGraphicsPipelines = |
        device: vk::Device, cache: vk::PipelineCache, count: u32, infos: *const vk::GraphicsPipelineCreateInfo<'_>,
        callbacks: Callbacks<'_>, pipelines: *mut vk::Pipeline
    | -> vk::Result => format!("pipelines of {cache:?}");
    vkCmdBeginDebugUtilsLabelEXT: vk::PFN_vkCmdBeginDebugUtilsLabelEXT = |
        cmd: Cmd, info: *const vk::DebugUtilsLabelEXT<'_>
    | format!("begin {}", CStr::from_ptr((*info).p_label_name).to_str().expect("UTF-8"));
    vkCmdEndDebugUtilsLabelEXT: vk::PFN_vkCmdEndDebugUtilsLabelEXT = |cmd: Cmd| "end".to_owned();
    vkCmdBindPipeline: vk::PFN_vkCmdBindPipeline = |
        cmd: Cmd, point: vk::PipelineBindPoint, pipeline: vk::Pipeline
    | format!("pipeline to {point:?}");
    vkCmdBindDescriptorSets: vk::PFN_vkCmdBindDescriptorSets = |
        cmd: Cmd, point: vk::PipelineBindPoint, layout: vk::PipelineLayout, first: u32, count: u32,
        sets: *const vk::DescriptorSet, offset_count: u32, offsets: *const u32
    | (0..offset_count as usize).fold("bind".to_owned(), |line, i| format!("{line} {}", *offsets.add(i)));
    vkCmdDispatch: vk::PFN_vkCmdDispatch = |cmd: Cmd, x: u32, y: u32, z: u32| format!("dispatch {x} {y} {z}");
    vkCmdDispatchIndirect: vk::PFN_vkCmdDispatchIndirect = |
        cmd: Cmd, buffer: vk::Buffer, at: u64
    | format!("indirect dispatch at {at}");
    vkCmdWriteTimestamp: vk::PFN_vkCmdWriteTimestamp = |
        cmd: Cmd, stage: vk::PipelineStageFlags, pool: vk::QueryPool, query: u32
    | format!("timestamp {query}");
    vkCmdPushConstants: vk::PFN_vkCmdPushConstants = |
        cmd: Cmd, layout: vk::PipelineLayout, stages: vk::ShaderStageFlags, at: u32, size: u32, values: *const c_void
    | format!("push {at} {size}: {:?}", from_raw_parts(values.cast::<u8>(), size as usize));
    vkCmdPipelineBarrier: vk::PFN_vkCmdPipelineBarrier = |
        cmd: Cmd, before: vk::PipelineStageFlags, after: vk::PipelineStageFlags, flags: vk::DependencyFlags,
        memories: u32, memory: *const vk::MemoryBarrier<'_>, buffers: u32, buffer: *const vk::BufferMemoryBarrier<'_>,
        images: u32, image: *const vk::ImageMemoryBarrier<'_>
    | format!("barrier {before:?} {after:?}");
}

fn is_storage_buffer(kind: vk::DescriptorType) -> bool {
    [vk::DescriptorType::STORAGE_BUFFER, vk::DescriptorType::STORAGE_BUFFER_DYNAMIC].contains(&kind)
}

/// A number for the words of a module.
pub fn hash(words: &[u32]) -> u64 {
    words.iter().fold(0xcbf2_9ce4_8422_2325, |h, x| (h ^ u64::from(*x)).wrapping_mul(0x100_0000_01b3))
}

/// The specialization constants of a stage, which are numbered from 0.
///
/// # Safety
/// The stage's specialization is valid, or null.
unsafe fn constants(stage: &vk::PipelineShaderStageCreateInfo<'_>) -> String {
    // SAFETY: the caller's obligation.
    unsafe {
        let Some(info) = stage.p_specialization_info.as_ref().filter(|info| info.map_entry_count > 0) else {
            return String::new();
        };
        let entries = from_raw_parts(info.p_map_entries, info.map_entry_count as usize);
        let numbered = (0..).zip(entries).all(|(i, entry)| entry.constant_id == i && entry.size == 4);
        assert!(numbered, "32-bit constants in the order of their numbers");
        let value = |entry: &vk::SpecializationMapEntry| info.p_data.byte_add(entry.offset as usize).cast::<u32>();
        entries.iter().map(|entry| format!(" {}", value(entry).read_unaligned())).collect()
    }
}
