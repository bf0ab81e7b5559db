//! Published techniques of others, for comparison with those of [`deltamorph`]: one file per technique, which
//! implements `Technique` like those of the library.
//!
//! `vertex-store` is a dense path with another kernel, `scatter` adds into integer sums, the direct paths evaluate the
//! pose in every draw (`draws`), and `texture` blends displacements into textures that draws fetch. An engine takes
//! them from [`TECHNIQUES`].
//!
//! They use items that the library marks as unstable (its feature `internals`), since a technique needs the access that
//! the library's own have. Their kernels are rows of the library's table, linked by its feature `baselines`, and share
//! the library's headers, formats and build script.

mod attributes;
mod direct;
mod draws;
#[cfg(test)]
#[path = "../../tests/common/hazards.rs"]
mod hazards;
mod paths;
mod scatter;
#[cfg(test)]
#[path = "../../tests/common/testing.rs"]
mod testing;
mod texture;
mod vertex_store;

use crate::gpu::device::Device;
use crate::gpu::mesh::{MeshBuffers, Upload};
use crate::update::dense::technique::DenseTechnique;
use crate::update::technique::{Context, Technique, Techniques};
use deltamorph::ash::vk;
use deltamorph::internals::{abi, asset, gpu, pack, plan, update, weights};
use deltamorph::{Error, PackedMesh, Result, UpdatePath};
pub use paths::{DIRECT, DIRECT_ATTRIBUTES, PATHS, SCATTER, TEXTURE, VERTEX_STORE};
use std::any::Any;
use std::sync::Arc;

/// The techniques to pass to [`MorphEngine::set_techniques`](deltamorph::MorphEngine::set_techniques).
pub static TECHNIQUES: Techniques = Techniques { make, upload };

fn make(context: Context<'_>) -> Result<Box<dyn Technique>> {
    Ok(match context.desc.update.path {
        VERTEX_STORE => Box::new(DenseTechnique::<vertex_store::StorePasses>::new(context)?),
        SCATTER => Box::new(scatter::ScatterTechnique::new(context)?),
        DIRECT => Box::new(draws::DrawTechnique::<direct::DirectDraws>::new(context)?),
        DIRECT_ATTRIBUTES => Box::new(draws::DrawTechnique::<attributes::AttributeDraws>::new(context)?),
        TEXTURE => Box::new(texture::TextureTechnique::new(context)?),
        path => return Err(Error::invalid(format!("update path '{}'", path.name()), "it is one of the library's own")),
    })
}

/// # Safety
/// Those of [`UploadFor`](deltamorph::internals::update::technique::UploadFor).
unsafe fn upload(
    device: &Arc<Device>,
    cmd: vk::CommandBuffer,
    mesh: &PackedMesh,
    path: UpdatePath,
) -> Result<(Vec<MeshBuffers>, Vec<Upload>)> {
    match path {
        SCATTER => scatter::upload(device, mesh),
        // SAFETY: the caller's obligations.
        _ => unsafe { texture::upload(device, cmd, mesh) },
    }
}

/// Refuses a mesh whose pose, or whose `words` of the technique, exceed a descriptor's range.
fn check_storage(device: &Device, mesh: &deltamorph::PackedLayout, what: &str, words: &[u32]) -> Result<()> {
    let bytes = size_of_val(words) as u64;
    [("a pose takes", mesh.base_bytes()), (what, bytes)].into_iter().try_for_each(|(what, bytes)| {
        let (what, range) = (format!("mesh '{}': {what}", mesh.name), device.caps.max_storage_range);
        device.caps.check_limit(&what, (bytes, "bytes", range), "use fewer targets, or split the mesh")
    })
}

/// Data that a technique keeps with a mesh that was uploaded for it.
fn private<T: Any>(mesh: &MeshBuffers) -> &T {
    let kept = mesh.private.as_ref().and_then(|kept| kept.downcast_ref());
    let Some(kept) = kept else { unreachable!("a mesh that was uploaded for another path is refused") };
    kept
}
