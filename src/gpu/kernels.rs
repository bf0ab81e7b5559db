//! Pipelines that were made once are shared by all crowds that take the same ones.

use super::device::Device;
use crate::error::Result;
use std::any::Any;
use std::sync::{Arc, Mutex, PoisonError};

/// Pipelines and what belongs to them, made for a key.
pub(crate) trait Kernel: Any + Send + Sync + Sized {
    /// What tells two of a kind apart.
    type Key: Copy + PartialEq;

    /// Make the pipelines.
    ///
    /// # Errors
    /// Those of Vulkan.
    fn new(device: &Arc<Device>, key: Self::Key) -> Result<Self>;

    /// What they were made for.
    fn key(&self) -> Self::Key;
}

/// The kernels made so far.
pub(crate) struct Kernels {
    device: Arc<Device>,
    made: Mutex<Vec<Arc<dyn Any + Send + Sync>>>,
}

impl Kernels {
    pub(crate) fn new(device: &Arc<Device>) -> Self {
        Self { device: device.clone(), made: Mutex::default() }
    }

    /// The kernel of `key`: the one there is, or a new one.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub(crate) fn get<K: Kernel>(&self, key: K::Key) -> Result<Arc<K>> {
        let locked = || self.made.lock().unwrap_or_else(PoisonError::into_inner);
        let find = |made: &[Arc<dyn Any + Send + Sync>]| {
            let mut of_kind = made.iter().filter_map(|kernel| kernel.clone().downcast::<K>().ok());
            of_kind.find(|kernel| kernel.key() == key)
        };
        let found = find(&locked());
        if let Some(kernel) = found {
            return Ok(kernel);
        }
        // Not locked while the driver compiles: others may make crowds of kernels that are there.
        let kernel = Arc::new(K::new(&self.device, key)?);
        let mut made = locked();
        // Another thread may have made it meanwhile.
        Ok(find(&made).unwrap_or_else(|| {
            made.push(kernel.clone());
            kernel
        }))
    }
}
