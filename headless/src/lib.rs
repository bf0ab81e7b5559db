//! A Vulkan instance, device and queue without a window, and crowds that are updated, timed, drawn and read back on
//! them: for the command line, examples and tests. Hosts of deltamorph use their own device instead.

mod bandwidth;
mod crowd;
mod draw;
mod image;
mod load;
mod submit;
mod turn;
mod wait;

pub use bandwidth::Bandwidth;
pub use crowd::{HeadlessCrowd, Recorded, Step};
#[doc(hidden)]
pub use draw::{Draws, PoseUpload};
#[doc(hidden)]
pub use image::{Image, ImageDesc, framebuffer, render_pass};
#[doc(hidden)]
pub use wait::wait_idle;

use crate::gpu::tuning::DeviceTuning;
use deltamorph::ash::{self, vk};
use deltamorph::internals::{abi, gpu, plan};
use deltamorph::{DeviceCaps, DeviceDesc, Error, GpuMesh, MorphEngine, Result};
use std::borrow::Cow;
use std::ffi::{CStr, c_void};
use std::sync::{Arc, Mutex, PoisonError};
use submit::Submitter;
use turn::Turn;

/// Choice of a device.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum DeviceChoice {
    /// A GPU if there is one, else the most capable software device.
    #[default]
    Best,
    /// The device at this index in [`Headless::devices`].
    Index(usize),
    /// The first device whose name or driver contains this, ignoring case.
    Name(String),
}

/// Options of [`Headless::new`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HeadlessDesc {
    /// Choice of the device.
    pub device: DeviceChoice,
    /// Load the validation layers, synchronization validation included, and collect their messages. Only one thread at
    /// a time can: others wait in [`Headless::new`] until its `Headless` are dropped.
    pub validation: bool,
    /// Limits to use where the device's are larger, such as [`DeviceCaps::android_baseline`].
    pub limits: Option<DeviceCaps>,
    /// Tuning to use in place of the device's own, to measure another.
    pub tuning: Option<DeviceTuning>,
}

/// An instance, a device, a queue, and an engine on it. To be used by one thread at a time:
///
/// ```compile_fail,E0277
/// fn shared_between_threads<T: Sync>() {}
/// shared_between_threads::<deltamorph_headless::Headless>();
/// ```
pub struct Headless {
    submitter: Submitter,
    engine: MorphEngine,
    /// Shared with the engine and all objects made with it, which keep it alive.
    owned: Arc<Owned>,
}

/// The device, destroyed before its instance.
struct Owned {
    device: ash::Device,
    physical: vk::PhysicalDevice,
    instance: Arc<Instance>,
}

impl Drop for Owned {
    fn drop(&mut self) {
        // SAFETY: everything made on the device is gone: the submitter was dropped before, and the engine and its
        // objects share this value.
        unsafe { self.device.destroy_device(None) };
    }
}

/// The loader, the instance, and the messenger that collects validation messages; also used by hosts with a window.
#[doc(hidden)]
pub struct Instance {
    // Keeps the Vulkan library loaded.
    pub entry: ash::Entry,
    pub raw: ash::Instance,
    messenger: Option<(ash::ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    // Shared with the messenger, which holds its address.
    pub messages: Arc<Messages>,
    // Held with the validation layers; dropped last.
    _turn: Option<Turn>,
}

/// Messages of the validation layers.
#[doc(hidden)]
pub type Messages = Mutex<Vec<String>>;

const VALIDATION: &CStr = c"VK_LAYER_KHRONOS_validation";

/// Collects messages of the layers.
///
/// # Safety
/// Called by the loader with `data` valid for the call and `user` the address of an [`Instance::messages`].
unsafe extern "system" fn collect(
    severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: `user` points to the messages, which live as long as the messenger; `data` is valid for the call.
    let (messages, data) = unsafe { (&*user.cast::<Messages>(), &*data) };
    // SAFETY: a message id and text are null or zero-terminated and valid for the call.
    let (id, text) = unsafe { (data.message_id_name_as_c_str(), data.message_as_c_str()) };
    fn show(text: Option<&CStr>) -> Cow<'_, str> {
        text.map_or(Cow::Borrowed(""), CStr::to_string_lossy)
    }
    let message = format!("{severity:?} {}: {}", show(id), show(text));
    messages.lock().unwrap_or_else(PoisonError::into_inner).push(message);
    vk::FALSE
}

/// Returns whether the validation layers have the setting that synchronization validation needs since 1.3.290; older
/// layers check shader accesses without it.
fn has_layer_settings(entry: &ash::Entry) -> bool {
    // SAFETY: the loader is alive.
    let layers = unsafe { entry.enumerate_instance_layer_properties() }.unwrap_or_default();
    let modern = |layer: &vk::LayerProperties| layer.spec_version >= vk::make_api_version(0, 1, 3, 290);
    layers.iter().any(|layer| layer.layer_name_as_c_str() == Ok(VALIDATION) && modern(layer))
}

impl Instance {
    /// Makes an instance with these surface extensions of the loader.
    pub fn new(extensions: &[&CStr], validation: bool) -> Result<Self> {
        let turn = validation.then(Turn::wait);
        // SAFETY: loading the system's Vulkan loader runs its initialisers, which are made for that.
        let entry = unsafe { ash::Entry::load() }.map_err(|e| Error::NoDevice {
            what: format!("the Vulkan loader cannot be loaded: {e}"),
            remedy: "install the Vulkan loader (on Linux ./with-vulkan does), or use the path 'cpu'",
        })?;
        let app = vk::ApplicationInfo::default().application_name(c"deltamorph").api_version(vk::API_VERSION_1_1);
        let messages = Arc::<Messages>::default();
        let mut messenger_info = vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(
                vk::DebugUtilsMessageSeverityFlagsEXT::WARNING | vk::DebugUtilsMessageSeverityFlagsEXT::ERROR,
            )
            .message_type(
                vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION | vk::DebugUtilsMessageTypeFlagsEXT::PERFORMANCE,
            )
            .pfn_user_callback(Some(collect))
            .user_data(Arc::as_ptr(&messages).cast_mut().cast());
        let enables = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
        let mut features = vk::ValidationFeaturesEXT::default().enabled_validation_features(&enables);
        // The older extension does not have the second setting, without which newer layers miss hazards between shader
        // accesses to storage buffers.
        let (on, off) = (vk::TRUE.to_ne_bytes(), vk::FALSE.to_ne_bytes());
        fn set<'a>(name: &'a CStr, values: &'a [u8]) -> vk::LayerSettingEXT<'a> {
            let kind = vk::LayerSettingTypeEXT::BOOL32;
            let mut setting =
                vk::LayerSettingEXT::default().layer_name(VALIDATION).setting_name(name).ty(kind).values(values);
            setting.value_count = 1; // `values` counts bytes
            setting
        }
        // They stop after ten messages of one kind otherwise.
        let settings = [
            set(c"validate_sync", &on),
            set(c"syncval_shader_accesses_heuristic", &on),
            set(c"enable_message_limit", &off),
        ];
        let mut settings = vk::LayerSettingsCreateInfoEXT::default().settings(&settings);
        let has_settings = validation && has_layer_settings(&entry);
        let layers = [VALIDATION.as_ptr()];
        let control = if has_settings { ash::ext::layer_settings::NAME } else { ash::ext::validation_features::NAME };
        let own = if validation { &[ash::ext::debug_utils::NAME, control][..] } else { &[] };
        // Drivers on other APIs, such as MoltenVK, are only listed for hosts that ask for them.
        let portability = ash::khr::portability_enumeration::NAME;
        // SAFETY: the loader is alive.
        let all = unsafe { entry.enumerate_instance_extension_properties(None) }.unwrap_or_default();
        let portability = all.iter().any(|e| e.extension_name_as_c_str() == Ok(portability)).then_some(portability);
        let extensions: Vec<_> = extensions.iter().chain(own).chain(&portability).map(|name| name.as_ptr()).collect();
        let flags = match portability {
            Some(_) => vk::InstanceCreateFlags::ENUMERATE_PORTABILITY_KHR,
            None => vk::InstanceCreateFlags::empty(),
        };
        let mut info = vk::InstanceCreateInfo::default().flags(flags).application_info(&app);
        info = info.enabled_extension_names(&extensions);
        if validation {
            info = info.enabled_layer_names(&layers).push_next(&mut messenger_info);
            info = if has_settings { info.push_next(&mut settings) } else { info.push_next(&mut features) };
        }
        // SAFETY: everything that `info` points to is alive; the messenger's user data outlives the instance.
        let raw = unsafe { entry.create_instance(&info, None) }.map_err(|e| match e {
            vk::Result::ERROR_LAYER_NOT_PRESENT if validation => Error::invalid(
                "the Vulkan validation layers are missing",
                "install the Vulkan validation layers (on Linux ./with-vulkan does)",
            ),
            vk::Result::ERROR_INCOMPATIBLE_DRIVER => no_device("no Vulkan driver"),
            e => Error::vulkan("vkCreateInstance")(e),
        })?;
        let mut instance = Self { messenger: None, messages, raw, entry, _turn: turn };
        if validation {
            let functions = ash::ext::debug_utils::Instance::new(&instance.entry, &instance.raw);
            messenger_info.p_next = std::ptr::null();
            // SAFETY: the extension is enabled; the user data is shared and lives until after the messenger.
            let messenger = unsafe { functions.create_debug_utils_messenger(&messenger_info, None) }
                .map_err(Error::vulkan("vkCreateDebugUtilsMessengerEXT"))?;
            instance.messenger = Some((functions, messenger));
        }
        Ok(instance)
    }

    fn devices(&self) -> Result<Vec<(vk::PhysicalDevice, DeviceCaps)>> {
        // SAFETY: the instance is alive, and was created for Vulkan 1.1.
        unsafe { devices(&self.raw) }
    }
}

/// Returns the instance's devices with Vulkan 1.1, and their limits.
///
/// # Errors
/// A Vulkan call fails.
///
/// # Safety
/// The instance is alive, and was created for Vulkan 1.1.
pub unsafe fn devices(instance: &ash::Instance) -> Result<Vec<(vk::PhysicalDevice, DeviceCaps)>> {
    // SAFETY: the caller's obligation; the devices are the instance's own. Vulkan 1.0 devices are only asked for Vulkan
    // 1.0 properties.
    unsafe {
        let mut all = instance.enumerate_physical_devices().map_err(Error::vulkan("vkEnumeratePhysicalDevices"))?;
        all.retain(|device| instance.get_physical_device_properties(*device).api_version >= vk::API_VERSION_1_1);
        all.into_iter().map(|device| Ok((device, DeviceCaps::query(instance, device)?))).collect()
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: made in `new`, destroyed once, after its device (see `Owned`).
        unsafe {
            if let Some((functions, messenger)) = self.messenger.take() {
                functions.destroy_debug_utils_messenger(messenger, None);
            }
            self.raw.destroy_instance(None);
        }
    }
}

impl Headless {
    /// Returns every Vulkan 1.1 device of the system; none without a loader or driver.
    ///
    /// # Errors
    /// Any other call fails.
    pub fn devices() -> Result<Vec<DeviceCaps>> {
        match Instance::new(&[], false) {
            Ok(instance) => Ok(instance.devices()?.into_iter().map(|(_, caps)| caps).collect()),
            Err(Error::NoDevice { .. }) => Ok(vec![]),
            Err(e) => Err(e),
        }
    }

    /// Sets up instance, device and queue.
    ///
    /// # Errors
    /// [`Error::NoDevice`]: no loader, no driver, or no Vulkan 1.1 device. Other errors: no device matches the choice
    /// (the message lists the devices), no validation layers, or a call fails.
    pub fn new(desc: &HeadlessDesc) -> Result<Self> {
        let instance = Instance::new(&[], desc.validation)?;
        let (physical, mut caps) = choose(instance.devices()?, &desc.device)?;
        if let Some(limits) = &desc.limits {
            caps.clamp_to(limits);
        }
        caps.tuning = desc.tuning.unwrap_or(caps.tuning);
        // SAFETY: the physical device is the instance's own.
        let families = unsafe { instance.raw.get_physical_device_queue_family_properties(physical) };
        let wanted = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
        let family = families.iter().position(|f| f.queue_flags.contains(wanted)).ok_or_else(|| {
            Error::invalid(
                format!("{} has no queue with graphics and compute", caps.name),
                "choose another device with --device",
            )
        })? as u32;
        // SAFETY: the instance's own device, with this queue family.
        unsafe { Self::on(Arc::new(instance), physical, family, caps, &[]) }
    }

    /// Makes device and queue, with these extensions besides those of the engine, for hosts with a window.
    ///
    /// # Errors
    /// A call fails.
    ///
    /// # Safety
    /// The physical device is the instance's own, and has the extensions, these limits, and a queue with graphics and
    /// compute in this family.
    #[doc(hidden)]
    pub unsafe fn on(
        instance: Arc<Instance>,
        physical: vk::PhysicalDevice,
        family: u32,
        caps: DeviceCaps,
        extensions: &[&CStr],
    ) -> Result<Self> {
        // SAFETY: the caller's obligation.
        let families = unsafe { instance.raw.get_physical_device_queue_family_properties(physical) };
        let timestamps = (families[family as usize].timestamp_valid_bits, caps.timestamp_period);
        let feedback_enabled = caps.transform_feedback.is_some();
        let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&[1.0])];
        let own = [
            caps.portability.then_some(ash::khr::portability_subset::NAME),
            feedback_enabled.then_some(ash::ext::transform_feedback::NAME),
        ];
        let extensions: Vec<_> =
            extensions.iter().copied().chain(own.into_iter().flatten()).map(CStr::as_ptr).collect();
        let mut feedback = vk::PhysicalDeviceTransformFeedbackFeaturesEXT::default().transform_feedback(true);
        let features = vk::PhysicalDeviceFeatures::default()
            .vertex_pipeline_stores_and_atomics(caps.vertex_stores)
            .shader_int64(caps.int64);
        let info = vk::DeviceCreateInfo::default().queue_create_infos(&queues).enabled_features(&features);
        let info = info.enabled_extension_names(&extensions);
        let info = if feedback_enabled { info.push_next(&mut feedback) } else { info };
        // SAFETY: the caller's obligation; the engine's extension and features were queried.
        let device = unsafe { instance.raw.create_device(physical, &info, None) };
        let device = device.map_err(Error::vulkan("vkCreateDevice"))?;
        let debug_names = instance.messenger.is_some();
        let owned = Arc::new(Owned { device, physical, instance });
        let engine_desc = DeviceDesc {
            caps: Some(caps),
            transform_feedback_enabled: feedback_enabled,
            enabled_features: features,
            debug_names,
            owner: Some(owned.clone()),
            ..DeviceDesc::new(&owned.instance.raw, physical, &owned.device)
        };
        // SAFETY: the handles belong together, and the engine and its objects keep them alive; the limits are at most
        // the device's.
        let engine = unsafe { MorphEngine::new(&engine_desc) }?;
        let submitter = Submitter::new(&owned.device, family, timestamps)?;
        Ok(Self { submitter, engine, owned })
    }

    /// Returns the engine on this device.
    pub fn engine(&self) -> &MorphEngine {
        &self.engine
    }

    /// Returns limits and features, clamped to [`HeadlessDesc::limits`].
    pub fn caps(&self) -> &DeviceCaps {
        self.engine().caps()
    }

    /// Returns the messages of the validation layers so far.
    pub fn messages(&self) -> Vec<String> {
        self.owned.instance.messages.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Returns instance, physical device and device, for callers that draw poses as hosts do.
    #[doc(hidden)]
    pub fn handles(&self) -> (&ash::Instance, vk::PhysicalDevice, &ash::Device) {
        (&self.owned.instance.raw, self.owned.physical, &self.owned.device)
    }

    /// Returns the queue, which has graphics and compute, and its family, for callers that submit without waiting.
    #[doc(hidden)]
    pub fn queue(&self) -> (vk::Queue, u32) {
        self.submitter.queue
    }

    /// Records a command buffer with `f`, submits it and waits, for callers that draw poses as hosts do.
    ///
    /// # Errors
    /// Those of `f`; the device fails.
    #[doc(hidden)]
    pub fn run<R>(&self, f: impl FnOnce(vk::CommandBuffer) -> Result<R>) -> Result<R> {
        self.submitter.run(f)
    }

    /// Reads ranges of engine buffers that are not in use, each given by offset and size, multiples of 4.
    ///
    /// # Errors
    /// Out of memory; the device fails.
    #[doc(hidden)]
    pub fn read(&self, ranges: &[(vk::Buffer, u64, u64)]) -> Result<Vec<Vec<u8>>> {
        let most = ranges.iter().map(|range| range.2).max().unwrap_or(0).max(4);
        let mut readback = submit::Readback::new(self.engine.device(), most)?;
        ranges.iter().map(|&range| readback.read(&self.submitter, range)).collect()
    }

    /// Runs the recorded upload of a mesh, and waits.
    ///
    /// # Errors
    /// Those of `record`; the device fails.
    #[doc(hidden)]
    pub fn upload(&self, record: impl FnOnce(vk::CommandBuffer) -> Result<GpuMesh>) -> Result<GpuMesh> {
        let mut mesh = self.submitter.run(record)?;
        mesh.release_staging();
        Ok(mesh)
    }
}

impl DeviceChoice {
    /// Returns whether the device at this index in [`Headless::devices`] matches the choice.
    pub fn matches(&self, index: usize, caps: &DeviceCaps) -> bool {
        match self {
            Self::Best => true,
            Self::Index(i) => *i == index,
            Self::Name(name) => {
                let all = format!("{} {} {}", caps.name, caps.driver, caps.driver_info);
                all.to_lowercase().contains(&name.to_lowercase())
            }
        }
    }
}

/// Makes the error for a system without a device.
fn no_device(what: &str) -> Error {
    Error::NoDevice {
        what: what.into(),
        remedy: "install a driver (on Linux ./with-vulkan installs lavapipe), or use the path 'cpu'",
    }
}

fn choose(
    mut devices: Vec<(vk::PhysicalDevice, DeviceCaps)>,
    choice: &DeviceChoice,
) -> Result<(vk::PhysicalDevice, DeviceCaps)> {
    let best = |caps: &DeviceCaps| (caps.is_software(), caps.transform_feedback.is_none());
    let matching = (0..devices.len()).filter(|&i| choice.matches(i, &devices[i].1));
    let at = matching.min_by_key(|&i| (*choice == DeviceChoice::Best).then(|| best(&devices[i].1)));
    at.map(|i| devices.swap_remove(i)).ok_or_else(|| {
        let names: Vec<String> = devices.iter().enumerate().map(|(i, (_, c))| format!("{i}: {}", c.name)).collect();
        let what = match choice {
            DeviceChoice::Best => "no Vulkan 1.1 device".to_owned(),
            DeviceChoice::Index(i) => format!("no Vulkan device {i}"),
            DeviceChoice::Name(name) => format!("no Vulkan device called '{name}'"),
        };
        if names.is_empty() {
            no_device(&what)
        } else {
            Error::invalid(what, format!("choose one of: {}", names.join("; ")))
        }
    })
}
