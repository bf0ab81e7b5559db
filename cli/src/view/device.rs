//! Instance, device and queue as in a host that links deltamorph: with a window to present to, and the engine on
//! top.

use crate::output::{Failure, Result};
use ash_window::{create_surface, enumerate_required_extensions};
use deltamorph::ash::{self, khr, vk};
use deltamorph::{DeviceCaps, Error};
pub use deltamorph_headless::Messages;
use deltamorph_headless::{self as headless, DeviceChoice, Headless, Instance};
use std::ffi::CStr;
use std::ptr::null_mut;
use std::sync::Arc;
use winit::raw_window_handle::{HasDisplayHandle, HasWindowHandle, RawDisplayHandle, RawWindowHandle};
use winit::window::Window;

/// A device that presents to a window. Everything created on it is dropped before it.
pub struct Device {
    pub swapchains: khr::swapchain::Device,
    pub surface: Surface,
    pub headless: Headless,
}

/// The window's surface, which is destroyed before instance and window.
pub struct Surface {
    pub raw: vk::SurfaceKHR,
    pub functions: khr::surface::Instance,
    instance: Arc<Instance>,
    _window: Arc<Window>,
}

impl Drop for Surface {
    fn drop(&mut self) {
        // SAFETY: created in `Device::new`, destroyed once; its swapchains are gone: see `Device`.
        unsafe { self.functions.destroy_surface(self.raw, None) };
    }
}

/// Turns a Vulkan result into a failure that names the call.
pub fn failed(call: &'static str) -> impl Fn(vk::Result) -> Failure {
    move |result| failure(Error::vulkan(call)(result))
}

/// The failure of what the window needs.
pub fn failure(error: Error) -> Failure {
    match error {
        Error::OutOfMemory { what, .. } => {
            Failure::Failed(format!("{what}; free memory, or use a smaller mesh or window"))
        }
        Error::Vulkan { result: vk::Result::ERROR_EXTENSION_NOT_PRESENT, .. } => cannot_show(&error.to_string()),
        Error::NoDevice { what, .. } => cannot_show(&what),
        error => error.into(),
    }
}

const NO_DRIVER: &str = "no Vulkan driver does";

/// The failure if no device can present to a window here.
fn cannot_show(why: &str) -> Failure {
    Failure::Failed(format!(
        "no Vulkan device can present to a window here: {why}; `deltamorph render` draws pictures without one"
    ))
}

impl Device {
    /// The chosen device, or else a GPU rather than a software driver, among those that can present to the window.
    pub fn new(window: &Arc<Window>, choice: Option<&DeviceChoice>, validation: bool) -> Result<Self> {
        let handles = (window.display_handle(), window.window_handle());
        let (Ok(display), Ok(handle)) = (handles.0.map(|h| h.as_raw()), handles.1.map(|h| h.as_raw())) else {
            return Err(cannot_show(NO_DRIVER));
        };
        let extensions = enumerate_required_extensions(display).map_err(|_| cannot_show(NO_DRIVER))?;
        // SAFETY: the names are constants, terminated by NUL.
        let extensions: Vec<&CStr> = extensions.iter().map(|name| unsafe { CStr::from_ptr(*name) }).collect();
        let instance = Arc::new(Instance::new(&extensions, validation).map_err(failure)?);
        let functions = khr::surface::Instance::new(&instance.entry, &instance.raw);
        // SAFETY: the handles are the window's, which outlives the surface; the extensions are enabled.
        let raw = unsafe { create_surface(&instance.entry, &instance.raw, display, handle, None) };
        let raw = raw.map_err(failed(match display {
            RawDisplayHandle::Xlib(_) => "vkCreateXlibSurfaceKHR",
            RawDisplayHandle::Xcb(_) => "vkCreateXcbSurfaceKHR",
            RawDisplayHandle::Wayland(_) => "vkCreateWaylandSurfaceKHR",
            _ => "vkCreate*SurfaceKHR",
        }))?;
        let surface = Surface { raw, functions, instance: instance.clone(), _window: window.clone() };
        let (physical, family, caps) = choose(&surface, (display, handle), choice)?;
        // SAFETY: device and family were chosen among the instance's.
        let headless = unsafe { Headless::on(instance, physical, family, caps, &[khr::swapchain::NAME]) };
        let headless = headless.map_err(failure)?;
        let (instance, _, device) = headless.handles();
        Ok(Self { swapchains: khr::swapchain::Device::new(instance, device), surface, headless })
    }

    pub fn raw(&self) -> &ash::Device {
        self.headless.handles().2
    }

    /// Waits until the device is idle. A lost device counts as idle.
    pub fn wait_idle(&self) {
        // SAFETY: only one thread uses the queue.
        let _ = unsafe { headless::wait_idle(self.raw()) };
    }

    /// Messages of the validation layers, including those from dropping the device.
    pub fn messages(&self) -> Arc<Messages> {
        self.surface.instance.messages.clone()
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
    surface: &Surface,
    window: (RawDisplayHandle, RawWindowHandle),
    choice: Option<&DeviceChoice>,
) -> Result<(vk::PhysicalDevice, u32, DeviceCaps)> {
    let instance = &surface.instance.raw;
    // SAFETY: the instance is alive, and was created for Vulkan 1.1.
    let caps = unsafe { headless::devices(instance) }?;
    let matching = caps.into_iter().enumerate().filter(|(i, (_, c))| choice.is_none_or(|choice| choice.matches(*i, c)));
    let mut names = vec![];
    let mut able = vec![];
    for (_, (physical, caps)) in matching {
        names.push(caps.name.clone());
        // SAFETY: the device belongs to the instance.
        let families = unsafe { instance.get_physical_device_queue_family_properties(physical) };
        for (i, family) in (0u32..).zip(families) {
            let wanted = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
            if family.queue_flags.contains(wanted) && presents(&surface.instance, physical, i, window) {
                // SAFETY: as above; the driver supports surfaces of this kind.
                let shows = unsafe { surface.functions.get_physical_device_surface_support(physical, i, surface.raw) };
                if shows.map_err(failed("vkGetPhysicalDeviceSurfaceSupportKHR"))? {
                    able.push((physical, i, caps));
                    break;
                }
            }
        }
    }
    able.into_iter().min_by_key(|(.., caps)| caps.is_software()).ok_or_else(|| match &names[..] {
        [] => cannot_show(NO_DRIVER),
        _ => cannot_show(&format!("not {}", names.join(", not "))),
    })
}
