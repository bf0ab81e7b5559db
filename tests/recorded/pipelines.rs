//! Pipelines are made with the host's cache.

use crate::gpu::{self, on_every_device, single, update_descs, weights};
use crate::testing;
use deltamorph::ash::{self, vk};
use deltamorph::{DeltaFormat, DeviceDesc, MorphEngine};
use std::sync::Mutex;

/// The caches passed to [`seen_compute`] and [`seen_graphics`].
static CACHES: Mutex<Vec<vk::PipelineCache>> = Mutex::new(vec![]);
/// The driver's own functions.
static CREATE: Mutex<Option<(vk::PFN_vkCreateComputePipelines, vk::PFN_vkCreateGraphicsPipelines)>> = Mutex::new(None);

macro_rules! seen {
    ($name:ident, $info:ident, $which:tt) => {
        unsafe extern "system" fn $name(
            device: vk::Device,
            cache: vk::PipelineCache,
            count: u32,
            infos: *const vk::$info<'_>,
            allocator: *const vk::AllocationCallbacks<'_>,
            pipelines: *mut vk::Pipeline,
        ) -> vk::Result {
            CACHES.lock().unwrap().push(cache);
            let create = CREATE.lock().unwrap().expect("set before").$which;
            // SAFETY: passed on unchanged.
            unsafe { create(device, cache, count, infos, allocator, pipelines) }
        }
    };
}
seen!(seen_compute, ComputePipelineCreateInfo, 0);
seen!(seen_graphics, GraphicsPipelineCreateInfo, 1);

/// Software drivers keep nothing in a cache that would show in its data, so the calls to the driver are intercepted.
#[test]
fn every_pipeline_is_made_with_the_cache_of_the_host() {
    on_every_device(|headless, _| {
        let (instance, physical, device) = headless.handles();
        let mut functions = device.fp_v1_0().clone();
        *CREATE.lock().unwrap() = Some((functions.create_compute_pipelines, functions.create_graphics_pipelines));
        (functions.create_compute_pipelines, functions.create_graphics_pipelines) = (seen_compute, seen_graphics);
        let (v1, v2, v3) = (device.fp_v1_1().clone(), device.fp_v1_2().clone(), device.fp_v1_3().clone());
        let device = ash::Device::from_parts_1_3(device.handle(), functions, v1, v2, v3);
        let mut data = vec![];
        // Again with the first run's cache data.
        for _ in 0..2 {
            let info = vk::PipelineCacheCreateInfo::default().initial_data(&data);
            // SAFETY: the device is alive, and the data are none or the driver's own.
            let pipeline_cache = unsafe { device.create_pipeline_cache(&info, None) }.expect("a cache");
            let mut desc = DeviceDesc::new(instance, physical, &device);
            desc.caps = Some(headless.caps().clone());
            desc.transform_feedback_enabled = headless.caps().transform_feedback.is_some();
            desc.pipeline_cache = pipeline_cache;
            // SAFETY: the handles belong together and outlive the engine; the limits are those of the device.
            let engine = unsafe { MorphEngine::new(&desc) }.expect("an engine");
            for format in [DeltaFormat::Snorm16, DeltaFormat::Fast] {
                let mesh = gpu::packed(&engine, &testing::mesh(300, 23), format);
                // SAFETY: `run` hands out a recording buffer of the engine's device, and waits.
                let uploaded = headless.run(|cmd| unsafe { engine.upload(cmd, &mesh) }).expect("an upload");
                for desc in update_descs(&engine, format) {
                    let mut crowd = engine.create_crowd(&uploaded, &single(desc)).expect("a crowd");
                    crowd.set_weights(0, &weights(&mesh, 1, 9)).expect("weights");
                    // SAFETY: as above.
                    headless.run(|cmd| unsafe { engine.record_update(cmd, &mut crowd) }).expect("an update");
                }
            }
            drop(engine);
            let caches = std::mem::take(&mut *CACHES.lock().unwrap());
            assert!(caches.len() > 3 && caches.iter().all(|cache| *cache == pipeline_cache), "{caches:?}");
            // SAFETY: the engine, which made pipelines with it, has been dropped.
            unsafe {
                data = device.get_pipeline_cache_data(pipeline_cache).expect("data");
                device.destroy_pipeline_cache(pipeline_cache, None);
            }
        }
        assert!(!data.is_empty());
    });
}
