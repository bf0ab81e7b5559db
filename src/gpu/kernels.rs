//! Pipelines that were made once are shared by all crowds that take the same ones.

use super::device::Device;
use super::pipelines::Objects;
use crate::error::Result;
use std::any::Any;
use std::sync::{Arc, Mutex, PoisonError};

/// What pipelines are made for.
pub(crate) trait PipelineKey: Any + Copy + PartialEq + Send + Sync {
    /// Make the pipelines, and what belongs to them.
    ///
    /// # Errors
    /// Those of Vulkan.
    fn make(self, objects: &mut Objects) -> Result<()>;
}

/// Pipelines and what belongs to them.
pub(crate) struct Pipelines<K> {
    pub(crate) objects: Objects,
    /// What they were made for.
    pub(crate) key: K,
}

/// The pipelines made so far.
pub(crate) struct Kernels {
    device: Arc<Device>,
    made: Mutex<Vec<Arc<dyn Any + Send + Sync>>>,
}

impl Kernels {
    pub(crate) fn new(device: &Arc<Device>) -> Self {
        Self { device: device.clone(), made: Mutex::default() }
    }

    /// The pipelines of `key`: those there are, or new ones.
    ///
    /// # Errors
    /// As [`PipelineKey::make`].
    pub(crate) fn get<K: PipelineKey>(&self, key: K) -> Result<Arc<Pipelines<K>>> {
        let locked = || self.made.lock().unwrap_or_else(PoisonError::into_inner);
        let find = |made: &[Arc<dyn Any + Send + Sync>]| {
            let mut of_kind = made.iter().filter_map(|pipelines| pipelines.clone().downcast::<Pipelines<K>>().ok());
            of_kind.find(|pipelines| pipelines.key == key)
        };
        let found = find(&locked());
        if let Some(pipelines) = found {
            return Ok(pipelines);
        }
        // Not locked while the driver compiles: others may make crowds of pipelines that are there.
        let mut objects = Objects::none(&self.device);
        key.make(&mut objects)?;
        let pipelines = Arc::new(Pipelines { objects, key });
        let mut made = locked();
        // Another thread may have made them meanwhile.
        Ok(find(&made).unwrap_or_else(|| {
            made.push(pipelines.clone());
            pipelines
        }))
    }
}
