//! Instance, device and queue as in a host that links deltamorph: with a window to present to, and the engine on
//! top.

use crate::output::Failure;
use ash_window::{create_surface, enumerate_required_extensions};
use deltamorph::ash::{self, ext, khr, vk};
use deltamorph::{DeviceCaps, DeviceDesc, Error, ErrorKind, MorphEngine};
pub use deltamorph_headless::Messages;
use deltamorph_headless::{self as headless, DeviceChoice, Instance};
use std::ffi::CStr;
use std::ptr::null_mut;
use std::slice::from_ref;
use std::sync::Arc;
use winit::raw_window_handle::{HasDisplayHandle, HasWindowHandle, RawDisplayHandle, RawWindowHandle};
use winit::window::Window;

/// A device that presents to a window. Everything created on it is dropped before it; the engine's share keeps it
/// alive.
pub struct Device {
    pub engine: MorphEngine,
    pub queue: vk::Queue,
    pub family: u32,
    pub swapchains: khr::swapchain::Device,
    owned: Arc<Owned>,
}

/// Handles that are destroyed together, in order.
struct Owned {
    device: ash::Device,
    physical: vk::PhysicalDevice,
    surface: vk::SurfaceKHR,
    surfaces: khr::surface::Instance,
    instance: Instance,
    // The surface is destroyed before its window.
    _window: Arc<Window>,
}

impl Drop for Owned {
    fn drop(&mut self) {
        // SAFETY: created in `Device::new`, destroyed once; everything created on the device is gone: see `Device`.
        unsafe {
            self.device.destroy_device(None);
            self.surfaces.destroy_surface(self.surface, None);
        }
    }
}

/// Turns a Vulkan result into a failure that names the call.
pub fn failed(call: &'static str) -> impl Fn(vk::Result) -> Failure {
    move |result| failure(Error::vulkan(call)(result))
}

fn failure(error: Error) -> Failure {
    match error {
        Error::Vulkan { call, result, .. } if error.kind() == ErrorKind::OutOfMemory => Failure::Failed(format!(
            "Vulkan: {call} failed: {result:?}; free memory, or draw fewer heads in a smaller window"
        )),
        Error::Vulkan { result: vk::Result::ERROR_EXTENSION_NOT_PRESENT, .. } => cannot_show(&error.to_string()),
        Error::NoDevice { what, .. } => cannot_show(&what),
        error => error.into(),
    }
}

/// The failure if no device can present to a window here.
fn no_window(names: &[String]) -> Failure {
    match names {
        [] => cannot_show("no Vulkan driver does"),
        _ => cannot_show(&format!("not {}", names.join(", not "))),
    }
}

fn cannot_show(why: &str) -> Failure {
    Failure::Failed(format!(
        "no Vulkan device can show in a window here: {why}; `deltamorph render` draws pictures without one"
    ))
}

impl Device {
    /// The chosen device, or else a GPU rather than a software driver, among those that can present to the window.
    pub fn new(window: &Arc<Window>, choice: Option<&DeviceChoice>, validation: bool) -> Result<Self, Failure> {
        let handles = (window.display_handle(), window.window_handle());
        let (Ok(display), Ok(handle)) = (handles.0.map(|h| h.as_raw()), handles.1.map(|h| h.as_raw())) else {
            return Err(no_window(&[]));
        };
        let extensions = enumerate_required_extensions(display).map_err(|_| no_window(&[]))?;
        // SAFETY: the names are constants, terminated by NUL.
        let extensions: Vec<&CStr> = extensions.iter().map(|name| unsafe { CStr::from_ptr(*name) }).collect();
        let instance = Instance::new(&extensions, validation).map_err(failure)?;
        let surfaces = khr::surface::Instance::new(&instance.entry, &instance.raw);
        // SAFETY: the handles are the window's, which outlives the surface (see `Owned`); the extensions are enabled.
        let surface = unsafe { create_surface(&instance.entry, &instance.raw, display, handle, None) };
        let surface = surface.map_err(failed(match display {
            RawDisplayHandle::Xlib(_) => "vkCreateXlibSurfaceKHR",
            RawDisplayHandle::Xcb(_) => "vkCreateXcbSurfaceKHR",
            RawDisplayHandle::Wayland(_) => "vkCreateWaylandSurfaceKHR",
            _ => "vkCreate*SurfaceKHR",
        }))?;
        let chosen =
            choose(&instance, &surfaces, surface, (display, handle), choice).and_then(|(physical, family, caps)| {
                let feedback = caps.transform_feedback.is_some();
                let mut extensions = vec![khr::swapchain::NAME.as_ptr()];
                extensions.extend(feedback.then_some(ext::transform_feedback::NAME.as_ptr()));
                extensions.extend(caps.portability.then_some(khr::portability_subset::NAME.as_ptr()));
                let mut captures = vk::PhysicalDeviceTransformFeedbackFeaturesEXT::default().transform_feedback(true);
                let features = vk::PhysicalDeviceFeatures::default().shader_int64(caps.int64);
                let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&[1.0])];
                let info = vk::DeviceCreateInfo::default().queue_create_infos(&queues).enabled_features(&features);
                let info = info.enabled_extension_names(&extensions);
                let info = if feedback { info.push_next(&mut captures) } else { info };
                // SAFETY: the physical device is the instance's; extensions and features were queried.
                let device = unsafe { instance.raw.create_device(physical, &info, None) };
                Ok((device.map_err(failed("vkCreateDevice"))?, physical, family, caps, features))
            });
        let (device, physical, family, caps, features) = chosen.inspect_err(|_| {
            // SAFETY: created above, and not in use.
            unsafe { surfaces.destroy_surface(surface, None) }
        })?;
        let owned = Arc::new(Owned { device, physical, surface, surfaces, instance, _window: window.clone() });
        let desc = DeviceDesc::new(&owned.instance.raw, physical, &owned.device)
            .transform_feedback_enabled(caps.transform_feedback.is_some())
            .caps(Some(caps))
            .enabled_features(features)
            .debug_names(validation)
            .owner(Some(owned.clone()));
        // SAFETY: the handles belong together; the engine and everything created with it keep them alive.
        let engine = unsafe { MorphEngine::new(&desc) }?;
        let swapchains = khr::swapchain::Device::new(&owned.instance.raw, &owned.device);
        // SAFETY: the device was created with this queue.
        let queue = unsafe { owned.device.get_device_queue(family, 0) };
        Ok(Self { engine, queue, family, swapchains, owned })
    }

    pub fn raw(&self) -> &ash::Device {
        &self.owned.device
    }

    pub fn instance(&self) -> &ash::Instance {
        &self.owned.instance.raw
    }

    pub fn physical(&self) -> vk::PhysicalDevice {
        self.owned.physical
    }

    pub fn surface(&self) -> (&khr::surface::Instance, vk::SurfaceKHR) {
        (&self.owned.surfaces, self.owned.surface)
    }

    /// Waits until the device is idle. A lost device counts as idle.
    pub fn wait_idle(&self) {
        // SAFETY: only one thread uses the queue.
        let _ = unsafe { headless::wait_idle(self.raw()) };
    }

    /// Records with `f`, submits and waits.
    pub fn run<R>(
        &self,
        pool: vk::CommandPool,
        f: impl FnOnce(vk::CommandBuffer) -> deltamorph::Result<R>,
    ) -> deltamorph::Result<R> {
        let device = self.raw();
        let info = vk::CommandBufferAllocateInfo::default().command_pool(pool).command_buffer_count(1);
        let once = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the buffer is new, submitted once, and freed when the queue is idle.
        unsafe {
            let cmd = device.allocate_command_buffers(&info).map_err(Error::vulkan("vkAllocateCommandBuffers"))?[0];
            device.begin_command_buffer(cmd, &once).map_err(Error::vulkan("vkBeginCommandBuffer"))?;
            let submit = vk::SubmitInfo::default().command_buffers(from_ref(&cmd));
            let recorded = f(cmd);
            let ended = device.end_command_buffer(cmd).map_err(Error::vulkan("vkEndCommandBuffer"));
            let ran = recorded.and_then(|result| {
                ended?;
                let submitted = device.queue_submit(self.queue, from_ref(&submit), vk::Fence::null());
                submitted.map_err(Error::vulkan("vkQueueSubmit"))?;
                let waited = device.queue_wait_idle(self.queue).map_err(Error::vulkan("vkQueueWaitIdle"));
                // If the wait fails for lack of memory, the work still runs: it may be dropped only once idle.
                waited.inspect_err(|_| self.wait_idle())?;
                Ok(result)
            });
            device.free_command_buffers(pool, &[cmd]);
            ran
        }
    }

    /// Messages of the validation layers, including those from dropping the device.
    pub fn messages(&self) -> Arc<Messages> {
        self.owned.instance.messages.clone()
    }
}

/// Whether a driver supports the window system at all. If not, it must not be queried about a surface: loaders
/// (1.3.239) pass it a handle that crashes it, as with SwiftShader, which supports only XCB.
fn presents(
    instance: &Instance,
    physical: vk::PhysicalDevice,
    family: u32,
    window: (RawDisplayHandle, RawWindowHandle),
) -> bool {
    let Instance { entry, raw, .. } = instance;
    match window {
        (RawDisplayHandle::Xlib(display), RawWindowHandle::Xlib(window)) => {
            let functions = khr::xlib_surface::Instance::new(entry, raw);
            let display = display.display.map_or(null_mut(), |d| d.as_ptr().cast());
            let visual = window.visual_id as u32;
            // SAFETY: the extension is enabled for this window; the display is the window's.
            unsafe { functions.get_physical_device_xlib_presentation_support(physical, family, display, visual) }
        }
        (RawDisplayHandle::Wayland(display), _) => {
            let functions = khr::wayland_surface::Instance::new(entry, raw);
            // SAFETY: as above.
            unsafe {
                let display = &mut *display.display.as_ptr().cast();
                functions.get_physical_device_wayland_presentation_support(physical, family, display)
            }
        }
        _ => true,
    }
}

/// Physical device, queue family with graphics and compute that can present to the surface, and limits.
fn choose(
    with_entry: &Instance,
    surfaces: &khr::surface::Instance,
    surface: vk::SurfaceKHR,
    window: (RawDisplayHandle, RawWindowHandle),
    choice: Option<&DeviceChoice>,
) -> Result<(vk::PhysicalDevice, u32, DeviceCaps), Failure> {
    let instance = &with_entry.raw;
    // SAFETY: the instance is alive, and was created for Vulkan 1.1.
    let caps = unsafe { headless::devices(instance) }?;
    let matching = caps.into_iter().enumerate().filter(|(i, (_, c))| choice.is_none_or(|choice| choice.matches(*i, c)));
    let matching: Vec<_> = matching.map(|(_, able)| able).collect();
    let names: Vec<String> = matching.iter().map(|(_, caps)| caps.name.clone()).collect();
    let wanted = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
    let family = |physical| {
        // SAFETY: the device belongs to the instance.
        let families = unsafe { instance.get_physical_device_queue_family_properties(physical) };
        for (i, family) in (0u32..).zip(families) {
            if family.queue_flags.contains(wanted) && presents(with_entry, physical, i, window) {
                // SAFETY: as above; the driver supports surfaces of this kind.
                let shows = unsafe { surfaces.get_physical_device_surface_support(physical, i, surface) };
                if shows.map_err(failed("vkGetPhysicalDeviceSurfaceSupportKHR"))? {
                    return Ok(Some(i));
                }
            }
        }
        Ok::<_, Failure>(None)
    };
    let has_swapchains = |physical| {
        // SAFETY: as above.
        let extensions = unsafe { instance.enumerate_device_extension_properties(physical) };
        let extensions = extensions.map_err(failed("vkEnumerateDeviceExtensionProperties"))?;
        Ok::<_, Failure>(extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(khr::swapchain::NAME)))
    };
    let mut able = vec![];
    for (physical, caps) in matching {
        if has_swapchains(physical)?
            && let Some(family) = family(physical)?
        {
            able.push((physical, family, caps));
        }
    }
    able.into_iter().min_by_key(|(.., caps)| caps.is_software()).ok_or_else(|| no_window(&names))
}
