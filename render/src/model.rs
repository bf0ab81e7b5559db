//! What is drawn of a mesh, and does not move: indices, texture coordinates, parts.

use crate::memory::Buffer;
use crate::parts::Part;
use crate::renderer::Renderer;
use bytemuck::cast_slice;
use deltamorph::ash::vk;
use deltamorph::{Error, GpuMesh, MorphMesh, PackedLayout, Result};
use glam::{Vec2, Vec4};
use std::ops::Range;

/// A mesh that was uploaded, as the renderer draws it.
pub struct Model {
    pub(crate) indices: Buffer,
    pub(crate) texcoords: Buffer,
    pub(crate) values: Buffer,
    pub(crate) base: (vk::Buffer, u64),
    pub(crate) parts: Vec<Drawn>,
    /// Where each vertex of the mesh is in pose buffers.
    places: Vec<u32>,
}

/// A part, as a range of the index buffer.
pub(crate) struct Drawn {
    pub(crate) indices: Range<u32>,
    pub(crate) material: crate::Material,
    pub(crate) ball: Option<Vec4>,
}

impl Model {
    /// Of a `mesh` that was packed as `layout` and uploaded as `uploaded`. `parts` say which triangles are made of what
    /// ([`parts`](crate::parts)); others are not drawn.
    ///
    /// A vertex has the texture coordinates of its first corner: of a [split](deltamorph::MorphSource::split) source those of
    /// all its corners.
    ///
    /// # Errors
    /// A layout of another mesh; no memory.
    ///
    /// # Safety
    /// The model is dropped before `uploaded` is, and only when nothing that was recorded with it is still to run.
    pub unsafe fn new(
        renderer: &Renderer,
        mesh: &MorphMesh,
        layout: &PackedLayout,
        uploaded: &GpuMesh,
        parts: &[Part],
    ) -> Result<Self> {
        let count = mesh.vertex_count();
        if count != layout.vertex_count {
            return Err(Error::Invalid {
                what: format!("a mesh of {count} vertices, and the layout of one of {}", layout.vertex_count),
                remedy: "hand in the layout of the packed mesh".into(),
            });
        }
        let mut places: Vec<u32> = (0..count as u32).collect();
        layout.remap_indices(&mut places)?;
        let render = mesh.faces.render_vertices(count, &mesh.texcoords)?;
        let (mut indices, mut drawn) = (vec![], vec![]);
        for part in parts {
            let begin = indices.len() as u32;
            indices.extend(part.triangles.iter().flatten().map(|&v| places[v as usize]));
            let range = begin..indices.len() as u32;
            drawn.push(Drawn { indices: range, material: part.material, ball: part.ball });
        }
        let padded = uploaded.base_pose().size as usize / 24;
        let mut texcoords = vec![Vec2::ZERO; padded];
        places.iter().zip(&render.texcoords).for_each(|(&place, &texcoord)| texcoords[place as usize] = texcoord);
        let (gpu, vertices) = (&renderer.gpu, vk::BufferUsageFlags::VERTEX_BUFFER);
        let base = uploaded.base_pose();
        Ok(Self {
            indices: Buffer::filled(gpu, cast_slice(&indices), vk::BufferUsageFlags::INDEX_BUFFER)?,
            texcoords: Buffer::filled(gpu, cast_slice(&texcoords), vertices)?,
            values: Buffer::new(gpu, 4 * padded.max(1), vertices, false)?,
            base: (base.buffer, base.offset),
            parts: drawn,
            places,
        })
    }

    /// Set the value of each vertex of the mesh, in its order, for [`Show::Values`](crate::Show::Values). No draw of the
    /// model is still to run.
    ///
    /// # Errors
    /// Another number of values.
    pub fn set_values(&mut self, values: &[f32]) -> Result<()> {
        if values.len() != self.places.len() {
            return Err(Error::Invalid {
                what: format!("{} values for {} vertices", values.len(), self.places.len()),
                remedy: "hand in one for each vertex of the mesh".into(),
            });
        }
        let most = self.places.iter().max().map_or(0, |&place| place as usize + 1);
        let mut placed = vec![0f32; most];
        self.places.iter().zip(values).for_each(|(&place, &value)| placed[place as usize] = value);
        self.values.write(0, cast_slice(&placed));
        Ok(())
    }
}
