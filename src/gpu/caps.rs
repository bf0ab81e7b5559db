//! Limits and features of a device that matter to update paths, and the requirements of each path.

use super::tuning::{DeviceClass, DeviceTuning};
use crate::error::{Error, Result, ensure};
use crate::pack::{DeltaFormat, PoseFormat};
use ash::vk;
use std::ffi::CStr;

/// Bytes of a vertex captured by transform feedback, which writes no other format.
pub(crate) const CAPTURE_STRIDE: usize = PoseFormat::Float32.stride();

/// Limits of transform feedback.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TransformFeedbackCaps {
    /// Largest size of a capture buffer, in bytes.
    pub max_buffer_bytes: u64,
    /// Largest distance between captured vertices, in bytes.
    pub max_stride: u32,
}

/// A device's limits and features. Can be clamped to a smaller profile before use.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct DeviceCaps {
    /// Device name.
    pub name: String,
    /// Driver name.
    pub driver: String,
    /// Driver version, in the driver's own words.
    pub driver_info: String,
    /// The kind of device.
    pub kind: vk::PhysicalDeviceType,
    /// Tuning for the device: kernels and tiles are chosen by it.
    #[doc(hidden)]
    pub tuning: DeviceTuning,
    /// Vulkan version: major, minor, patch.
    pub api_version: (u32, u32, u32),
    /// Most bytes that a storage-buffer descriptor can cover.
    #[doc(hidden)]
    pub max_storage_range: u64,
    /// Most texels in a texel buffer.
    #[doc(hidden)]
    pub max_texels: u32,
    /// Most bytes in one memory allocation.
    #[doc(hidden)]
    pub max_allocation: u64,
    /// Most bytes in one buffer, if the driver states it (VK_KHR_maintenance4); otherwise unlimited.
    #[doc(hidden)]
    pub max_buffer: u64,
    /// Most storage buffers in one shader stage.
    #[doc(hidden)]
    pub max_storage_buffers: u32,
    /// Most bytes of push constants.
    #[doc(hidden)]
    pub max_push_constants: u32,
    /// Most vertex attributes.
    #[doc(hidden)]
    pub max_vertex_attributes: u32,
    /// Most vertex-buffer bindings.
    #[doc(hidden)]
    pub max_vertex_bindings: u32,
    /// Most invocations in a workgroup.
    #[doc(hidden)]
    pub max_workgroup_invocations: u32,
    /// Most workgroups in x and in y.
    #[doc(hidden)]
    pub max_workgroups: u32,
    /// Nanoseconds per timestamp tick; 0 without timestamps.
    pub timestamp_period: f32,
    /// Limits of VK_EXT_transform_feedback; `None` without the extension or its feature.
    #[doc(hidden)]
    pub transform_feedback: Option<TransformFeedbackCaps>,
    /// Whether vertex shaders may write storage buffers (the feature `vertexPipelineStoresAndAtomics`).
    #[doc(hidden)]
    pub vertex_stores: bool,
    /// Whether textures of four float32 can be blended to, and loaded by shaders.
    #[doc(hidden)]
    pub float_blending: bool,
    /// Most texels of a 2D image in either direction.
    #[doc(hidden)]
    pub max_image_side: u32,
    /// Whether shaders may use 64-bit integers (the feature `shaderInt64`).
    #[doc(hidden)]
    pub int64: bool,
    /// Whether the driver stands on another API, as MoltenVK does: VK_KHR_portability_subset has to be enabled when the
    /// device is created. Nothing that it leaves out is needed here.
    #[doc(hidden)]
    pub portability: bool,
    /// Flags of each queue family, by its index.
    pub queue_families: Vec<vk::QueueFlags>,
}

/// An extension or feature that a path needs, and why.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Requirement {
    /// Name of the device extension to enable, if any.
    pub extension: Option<&'static CStr>,
    /// Name of the feature to enable, if any.
    pub feature: Option<&'static str>,
    /// The reason that the path needs it.
    pub reason: &'static str,
}

impl DeviceCaps {
    /// Whether the device is a software driver on the CPU. The path `cpu` is faster than such a device.
    pub fn is_software(&self) -> bool {
        self.kind == vk::PhysicalDeviceType::CPU
    }

    /// Asks the driver for its limits and features.
    ///
    /// # Errors
    /// [`Error::Vulkan`] if the driver cannot list its extensions, for lack of memory.
    ///
    /// # Safety
    /// - `physical` was enumerated from `instance`, and `instance` is alive.
    /// - Both are of Vulkan 1.1 or later.
    pub unsafe fn query(instance: &ash::Instance, physical: vk::PhysicalDevice) -> Result<Self> {
        // SAFETY: the caller's obligations are those of these calls.
        let (core, extensions, families, floats) = unsafe {
            (
                instance.get_physical_device_properties(physical),
                instance.enumerate_device_extension_properties(physical),
                instance.get_physical_device_queue_family_properties(physical),
                instance.get_physical_device_format_properties(physical, vk::Format::R32G32B32A32_SFLOAT),
            )
        };
        let extensions = extensions.map_err(Error::vulkan("vkEnumerateDeviceExtensionProperties"))?;
        let has = |name: &CStr| extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(name));
        let version = |v| (vk::api_version_major(v), vk::api_version_minor(v), vk::api_version_patch(v));
        let text = |raw: Result<&CStr, _>| raw.unwrap_or_default().to_string_lossy().into_owned();
        let with_feedback = has(ash::ext::transform_feedback::NAME);
        // Detected by extension only: structures of core 1.2 and 1.3 may not be chained if the instance is of version
        // 1.1.
        let with_driver = has(ash::khr::driver_properties::NAME);
        let with_buffer_size = has(ash::khr::maintenance4::NAME);
        let with_subgroup_sizes = has(ash::ext::subgroup_size_control::NAME);

        let mut maintenance = vk::PhysicalDeviceMaintenance3Properties::default();
        let mut subgroups = vk::PhysicalDeviceSubgroupProperties::default();
        let mut subgroup_sizes = vk::PhysicalDeviceSubgroupSizeControlProperties::default();
        let mut driver = vk::PhysicalDeviceDriverProperties::default();
        let mut maintenance4 = vk::PhysicalDeviceMaintenance4Properties::default().max_buffer_size(u64::MAX);
        let mut feedback = vk::PhysicalDeviceTransformFeedbackPropertiesEXT::default();
        let mut feedback_features = vk::PhysicalDeviceTransformFeedbackFeaturesEXT::default();
        let mut properties =
            vk::PhysicalDeviceProperties2::default().push_next(&mut maintenance).push_next(&mut subgroups);
        let mut features = vk::PhysicalDeviceFeatures2::default();
        if with_driver {
            properties = properties.push_next(&mut driver);
        }
        if with_buffer_size {
            properties = properties.push_next(&mut maintenance4);
        }
        if with_subgroup_sizes {
            properties = properties.push_next(&mut subgroup_sizes);
        }
        if with_feedback {
            properties = properties.push_next(&mut feedback);
            features = features.push_next(&mut feedback_features);
        }
        // SAFETY: as above; each structure chained is of core 1.1 or of an extension that the device lists.
        unsafe {
            instance.get_physical_device_properties2(physical, &mut properties);
            instance.get_physical_device_features2(physical, &mut features);
        }

        // Loaders emulate the call above for instances of Vulkan 1.0, and leave the chained structures as they are.
        ensure!(
            maintenance.max_memory_allocation_size > 0,
            "the Vulkan instance is of version 1.0",
            "create it with apiVersion 1.1 or later"
        );
        let limits = core.limits;
        let core_features = features.features;
        let narrowest = if with_subgroup_sizes { subgroup_sizes.min_subgroup_size } else { subgroups.subgroup_size };
        Ok(Self {
            name: text(core.device_name_as_c_str()),
            driver: text(driver.driver_name_as_c_str()),
            driver_info: text(driver.driver_info_as_c_str()),
            kind: core.device_type,
            tuning: match core.device_type {
                vk::PhysicalDeviceType::CPU => {
                    DeviceClass::Software.tuning().for_software(core.vendor_id, core.api_version)
                }
                _ => DeviceClass::of_vendor(core.vendor_id).tuning().for_gpu(core.vendor_id, narrowest),
            },
            api_version: version(core.api_version),
            max_storage_range: limits.max_storage_buffer_range.into(),
            max_texels: limits.max_texel_buffer_elements,
            max_allocation: maintenance.max_memory_allocation_size,
            max_buffer: maintenance4.max_buffer_size,
            max_storage_buffers: limits.max_per_stage_descriptor_storage_buffers,
            max_push_constants: limits.max_push_constants_size,
            max_vertex_attributes: limits.max_vertex_input_attributes,
            max_vertex_bindings: limits.max_vertex_input_bindings,
            max_workgroup_invocations: limits.max_compute_work_group_invocations,
            max_workgroups: limits.max_compute_work_group_count[0].min(limits.max_compute_work_group_count[1]),
            timestamp_period: limits.timestamp_period,
            transform_feedback: (with_feedback && feedback_features.transform_feedback == vk::TRUE).then_some(
                TransformFeedbackCaps {
                    max_buffer_bytes: feedback.max_transform_feedback_buffer_size,
                    max_stride: feedback.max_transform_feedback_buffer_data_stride,
                },
            ),
            vertex_stores: core_features.vertex_pipeline_stores_and_atomics == vk::TRUE,
            float_blending: floats
                .optimal_tiling_features
                .contains(vk::FormatFeatureFlags::COLOR_ATTACHMENT_BLEND | vk::FormatFeatureFlags::SAMPLED_IMAGE),
            max_image_side: limits.max_image_dimension2_d,
            int64: core_features.shader_int64 == vk::TRUE,
            portability: has(ash::khr::portability_subset::NAME),
            queue_families: families.iter().map(|family| family.queue_flags).collect(),
        })
    }

    /// Returns the limits that Khronos' VP_ANDROID_baseline_2022 guarantees, for [`clamp_to`](Self::clamp_to).
    pub fn android_baseline() -> Self {
        Self {
            name: String::new(),
            driver: String::new(),
            driver_info: String::new(),
            kind: vk::PhysicalDeviceType::OTHER,
            // Small blocks share workgroups, as on an Adreno.
            tuning: DeviceClass::Phone.tuning().for_gpu(0x5143, 64),
            api_version: (1, 1, 0),
            max_storage_range: 1 << 27,
            max_texels: 1 << 16,
            max_allocation: 1 << 30,
            max_buffer: 1 << 30,
            max_storage_buffers: 4,
            max_push_constants: 128,
            max_vertex_attributes: 16,
            max_vertex_bindings: 16,
            max_workgroup_invocations: 128,
            max_workgroups: 65_535,
            timestamp_period: 0.0,
            transform_feedback: None,
            vertex_stores: false,
            float_blending: false,
            max_image_side: 4096,
            int64: false,
            portability: false,
            queue_families: vec![],
        }
    }

    /// Reduces each limit to that of `limits` if it is smaller; nothing is raised. Names, versions, timestamps and the
    /// flags of queue families stay. Of the tuning, only the width of tiles, the fields for small blocks and the
    /// planner change.
    pub fn clamp_to(&mut self, limits: &Self) {
        self.tuning.widest_tile = self.tuning.widest_tile.min(limits.tuning.widest_tile);
        self.tuning.lanes = self.tuning.lanes.max(limits.tuning.lanes);
        self.tuning.few_registers |= limits.tuning.few_registers;
        self.tuning.plans_together |= limits.tuning.plans_together;
        macro_rules! clamp {
            ($($limit:ident)*) => {
                $(self.$limit = self.$limit.min(limits.$limit);)*
            };
        }
        clamp! {
            max_storage_range
            max_texels
            max_allocation
            max_buffer
            max_storage_buffers
            max_push_constants
            max_vertex_attributes
            max_vertex_bindings
            max_workgroup_invocations
            max_workgroups
            max_image_side
        }
        self.transform_feedback =
            self.transform_feedback.zip(limits.transform_feedback).map(|(a, b)| TransformFeedbackCaps {
                max_buffer_bytes: a.max_buffer_bytes.min(b.max_buffer_bytes),
                max_stride: a.max_stride.min(b.max_stride),
            });
        self.vertex_stores &= limits.vertex_stores;
        self.float_blending &= limits.float_blending;
        self.int64 &= limits.int64;
        self.queue_families.iter_mut().zip(&limits.queue_families).for_each(|(flags, limits)| *flags &= *limits);
    }

    /// Whether tiles of `format` are read as texels and decoded in 64-bit integers ([`DeviceTuning::texels`]).
    #[doc(hidden)]
    pub fn takes_texels(&self, format: DeltaFormat) -> bool {
        // A view of four-word texels then covers everything that a storage descriptor covers.
        let views = u64::from(self.max_texels) >= self.max_storage_range / 16;
        self.tuning.texels && self.int64 && views && format.is_blocks()
    }

    /// The capabilities of a queue family.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a family that does not exist.
    pub(crate) fn queue_flags(&self, family: u32) -> Result<vk::QueueFlags> {
        let found = self.queue_families.get(family as usize).copied();
        found.ok_or_else(|| {
            let text = format!("queue family {family} of {}, which has {}", self.name, self.queue_families.len());
            Error::invalid(text, "name one that vkGetPhysicalDeviceQueueFamilyProperties lists, counting from 0")
        })
    }

    /// Refuse more of something than the device has: `(amount, unit, most)`.
    #[doc(hidden)]
    pub fn check_limit(&self, what: &str, (amount, unit, most): (u64, &str, u64), remedy: &str) -> Result<()> {
        ensure!(amount <= most, format!("{what} {amount} {unit}, but {} allows {most}", self.name), remedy);
        Ok(())
    }
}
