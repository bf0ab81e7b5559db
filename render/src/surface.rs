//! Surfaces that a file states: base colours, textures, opacity.

use crate::memory::{Buffer, Gpu, Image, ImageDesc, failed};
use crate::renderer::Renderer;
use crate::srgb::{decoded, encoded};
use deltamorph::Result;
use deltamorph::ash::vk;
use deltamorph::import::gltf::{Alpha, Wrap};
use glam::Affine2;
use std::collections::HashMap;
use std::slice::from_ref;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// The surface of a part.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// Linear red, green, blue, and opacity; the factor of the texture, if there is one.
    pub colour: [f32; 4],
    /// The texture, on the mesh's texture coordinates (from the top left), and what it shows beyond its edges, across
    /// and down.
    pub texture: Option<(Arc<Pixels>, [Wrap; 2])>,
    /// The transform of texture coordinates before that.
    pub place: Affine2,
    /// The meaning of opacity. What is masked (above 0) or blended casts no shadow; blended parts are drawn in their order,
    /// after all others.
    pub alpha: Alpha,
    /// Whether back faces are drawn, too, lit from their own side.
    pub double_sided: bool,
}

/// A texture: red, green and blue in sRGB, and opacity.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pixels {
    /// Width and height (≥ 1).
    pub size: [u32; 2],
    /// Four bytes per pixel, row by row from the top.
    pub rgba: Vec<u8>,
}

impl Pixels {
    /// Returns the picture in half the size, colours averaged as light is.
    fn halved(&self) -> Self {
        let linear: [f32; 256] = std::array::from_fn(|i| decoded(i as u8));
        let [width, height] = self.size;
        let size = self.size.map(|edge| (edge / 2).max(1));
        let mut rgba = Vec::with_capacity(size[0] as usize * size[1] as usize * 4);
        for (y, x) in (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (y, x))) {
            let mut sums = [0.0; 4];
            for (right, down) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let (x, y) = ((2 * x + right).min(width - 1), (2 * y + down).min(height - 1));
                let pixel = &self.rgba[4 * (y as usize * width as usize + x as usize)..][..4];
                let light = |i: usize| if i < 3 { linear[usize::from(pixel[i])] } else { f32::from(pixel[i]) };
                (0..4).for_each(|i| sums[i] += light(i) / 4.0);
            }
            rgba.extend((0..4).map(|i| if i < 3 { encoded(sums[i]) } else { sums[i].round() as u8 }));
        }
        Self { size, rgba }
    }
}

/// The textures of a model, with a descriptor set for each way in which one is used.
pub(crate) struct Textures {
    gpu: Arc<Gpu>,
    pool: vk::DescriptorPool,
    samplers: HashMap<[Wrap; 2], vk::Sampler>,
    images: Vec<Uploaded>,
    /// Sets; the first has a white texture.
    pub(crate) sets: Vec<vk::DescriptorSet>,
    /// Whether no commands have filled the images yet.
    is_pending: AtomicBool,
}

/// An image, and what fills it.
struct Uploaded {
    image: Image,
    staging: Buffer,
    regions: Vec<vk::BufferImageCopy>,
}

impl Textures {
    /// Makes the textures of `surfaces`; returns the index of the set of each surface, too.
    pub(crate) fn new(renderer: &Renderer, surfaces: &[Arc<Surface>]) -> Result<(Self, Vec<usize>)> {
        let white = Arc::new(Pixels { size: [1; 2], rgba: vec![255; 4] });
        let used = std::iter::once((white, [Wrap::Repeat; 2]));
        let used: Vec<_> = used.chain(surfaces.iter().filter_map(|surface| surface.texture.clone())).collect();
        let (mut images, mut ways): (HashMap<_, usize>, HashMap<_, usize>) = Default::default();
        let mut this = Self {
            gpu: renderer.gpu.clone(),
            pool: vk::DescriptorPool::null(),
            samplers: HashMap::new(),
            images: vec![],
            sets: vec![],
            is_pending: AtomicBool::new(true),
        };
        let device = &renderer.gpu.device;
        let kind = vk::DescriptorType::COMBINED_IMAGE_SAMPLER;
        let size = vk::DescriptorPoolSize { ty: kind, descriptor_count: used.len() as u32 };
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(used.len() as u32).pool_sizes(from_ref(&size));
        // SAFETY: the device is alive as long as `renderer`; `drop` destroys the pool.
        this.pool = unsafe { device.create_descriptor_pool(&info, None) }.map_err(failed("vkCreateDescriptorPool"))?;
        for (pixels, wrap) in &used {
            let number = images.len();
            let at = *images.entry(Arc::as_ptr(pixels)).or_insert(number);
            if at == this.images.len() {
                this.images.push(Uploaded::new(renderer, pixels)?);
            }
            if ways.contains_key(&(at, *wrap)) {
                continue;
            }
            ways.insert((at, *wrap), this.sets.len());
            let sampler = this.sampler(*wrap)?;
            let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(this.pool);
            let info = info.set_layouts(from_ref(&renderer.texture_layout));
            let image = vk::DescriptorImageInfo::default().image_view(this.images[at].image.view).sampler(sampler);
            let image = [image.image_layout(vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL)];
            // SAFETY: the pool has room; the set is new; view and sampler are alive.
            unsafe {
                let set = device.allocate_descriptor_sets(&info).map_err(failed("vkAllocateDescriptorSets"))?[0];
                let write = vk::WriteDescriptorSet::default().dst_set(set).descriptor_type(kind).image_info(&image);
                device.update_descriptor_sets(&[write], &[]);
                this.sets.push(set);
            }
        }
        let of_surface = |surface: &Arc<Surface>| {
            surface.texture.as_ref().map_or(0, |(pixels, wrap)| ways[&(images[&Arc::as_ptr(pixels)], *wrap)])
        };
        let sets = surfaces.iter().map(of_surface).collect();
        Ok((this, sets))
    }

    fn sampler(&mut self, wrap: [Wrap; 2]) -> Result<vk::Sampler> {
        if let Some(sampler) = self.samplers.get(&wrap) {
            return Ok(*sampler);
        }
        let [u, v] = wrap.map(|wrap| match wrap {
            Wrap::Repeat => vk::SamplerAddressMode::REPEAT,
            Wrap::Mirror => vk::SamplerAddressMode::MIRRORED_REPEAT,
            Wrap::Clamp => vk::SamplerAddressMode::CLAMP_TO_EDGE,
        });
        let info = vk::SamplerCreateInfo::default().address_mode_u(u).address_mode_v(v).max_lod(vk::LOD_CLAMP_NONE);
        let linear = vk::Filter::LINEAR;
        let info = info.mag_filter(linear).min_filter(linear).mipmap_mode(vk::SamplerMipmapMode::LINEAR);
        // SAFETY: the device is alive; `drop` destroys the sampler.
        let made = unsafe { self.gpu.device.create_sampler(&info, None) }.map_err(failed("vkCreateSampler"))?;
        self.samplers.insert(wrap, made);
        Ok(made)
    }

    /// Records, once, what fills the images.
    ///
    /// # Safety
    /// `cmd` is recording, outside a render pass; it runs before all other commands that draw the model.
    pub(crate) unsafe fn upload(&self, cmd: vk::CommandBuffer) {
        if !self.is_pending.swap(false, Ordering::Relaxed) {
            return;
        }
        let device = &self.gpu.device;
        let (top, copy, draw) = (
            vk::PipelineStageFlags::TOP_OF_PIPE,
            vk::PipelineStageFlags::TRANSFER,
            vk::PipelineStageFlags::FRAGMENT_SHADER,
        );
        let (nothing, written) = (vk::AccessFlags::empty(), vk::AccessFlags::TRANSFER_WRITE);
        let (empty, filling) = (vk::ImageLayout::UNDEFINED, vk::ImageLayout::TRANSFER_DST_OPTIMAL);
        let read = vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL;
        for Uploaded { image, staging, regions } in &self.images {
            let range = vk::ImageSubresourceRange::default().aspect_mask(vk::ImageAspectFlags::COLOR).layer_count(1);
            let range = range.level_count(regions.len() as u32);
            let barrier = vk::ImageMemoryBarrier::default().image(image.raw).subresource_range(range);
            let barrier = barrier.src_queue_family_index(vk::QUEUE_FAMILY_IGNORED);
            let barrier = barrier.dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED);
            let before = barrier.src_access_mask(nothing).dst_access_mask(written);
            let before = [before.old_layout(empty).new_layout(filling)];
            let after = barrier.src_access_mask(written).dst_access_mask(vk::AccessFlags::SHADER_READ);
            let after = [after.old_layout(filling).new_layout(read)];
            // SAFETY: the caller's obligations; nothing has used the image before; the regions are within buffer and
            // image.
            unsafe {
                device.cmd_pipeline_barrier(cmd, top, copy, Default::default(), &[], &[], &before);
                device.cmd_copy_buffer_to_image(cmd, staging.raw, image.raw, filling, regions);
                device.cmd_pipeline_barrier(cmd, copy, draw, Default::default(), &[], &[], &after);
            }
        }
    }
}

impl Uploaded {
    /// Makes an image of `pixels`, with all smaller levels.
    fn new(renderer: &Renderer, pixels: &Pixels) -> Result<Self> {
        let most = renderer.gpu.limits.max_image_dimension2_d;
        let mut levels = vec![pixels.clone()];
        while let Some(smaller) = levels.last().filter(|level| level.size != [1; 2]).map(Pixels::halved) {
            levels.push(smaller);
        }
        levels.retain(|level| level.size[0].max(level.size[1]) <= most);
        let (mut bytes, mut regions) = (vec![], vec![]);
        for (number, level) in (0..).zip(&levels) {
            let layer = vk::ImageSubresourceLayers::default().aspect_mask(vk::ImageAspectFlags::COLOR);
            let layer = layer.mip_level(number).layer_count(1);
            let [width, height] = level.size;
            let region = vk::BufferImageCopy::default().buffer_offset(bytes.len() as u64).image_subresource(layer);
            regions.push(region.image_extent(vk::Extent3D { width, height, depth: 1 }));
            bytes.extend_from_slice(&level.rgba);
        }
        let [width, height] = levels[0].size;
        let desc = ImageDesc {
            extent: vk::Extent2D { width, height },
            format: vk::Format::R8G8B8A8_SRGB,
            samples: vk::SampleCountFlags::TYPE_1,
            levels: levels.len() as u32,
            usage: vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::TRANSFER_DST,
            aspect: vk::ImageAspectFlags::COLOR,
        };
        let image = Image::new(&renderer.gpu, &desc)?;
        let staging = Buffer::filled(&renderer.gpu, &bytes, vk::BufferUsageFlags::TRANSFER_SRC)?;
        Ok(Self { image, staging, regions })
    }
}

impl Drop for Textures {
    fn drop(&mut self) {
        let device = &self.gpu.device;
        // SAFETY: ours, destroyed once, and not in use: see `Renderer::new`.
        unsafe {
            device.destroy_descriptor_pool(self.pool, None);
            self.samplers.values().for_each(|sampler| device.destroy_sampler(*sampler, None));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smaller_levels_average_light() {
        let rgba = [[0, 255, 10, 255], [255, 255, 10, 0], [0, 255, 10, 255], [255, 255, 10, 0], [9; 4], [7; 4]];
        let pixels = Pixels { size: [2, 3], rgba: rgba.concat() };
        let half = pixels.halved();
        // Half the light is 188 of 255 in sRGB; half the opacity is half the number.
        assert_eq!((half.size, &half.rgba[..]), ([1, 1], &[188, 255, 10, 128][..]));
        assert_eq!(half.halved(), half);
    }
}
