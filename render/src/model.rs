//! The static data of a drawn mesh: indices, texture coordinates, parts.

use crate::glow::pieces_of;
use crate::memory::Buffer;
use crate::parts::Part;
use crate::renderer::Renderer;
use crate::scene::{Head, Masks};
use bytemuck::cast_slice;
use deltamorph::ash::vk;
use deltamorph::{Error, GpuMesh, MorphMesh, PackedLayout, Result};
use glam::{Vec2, Vec3, Vec4};
use std::collections::{BTreeSet, HashSet};
use std::ops::Range;

/// An uploaded mesh, with the data to draw it.
pub(crate) struct Model {
    pub(crate) indices: Buffer,
    /// Two vertices for each edge of a face.
    pub(crate) edges: (Buffer, u32),
    pub(crate) texcoords: Buffer,
    pub(crate) base: (vk::Buffer, u64),
    pub(crate) parts: Vec<Drawn>,
    /// Middle of the box around the drawn part of the base pose, and half its diagonal.
    pub(crate) middle: Vec4,
    /// Number of pieces in a [`Glow`](crate::Glow).
    pub(crate) pieces: usize,
    /// Vertices per block; for dense formats, of the mesh.
    pub(crate) block: u32,
    /// Parts that nothing moves.
    pub(crate) still: Option<Box<Model>>,
    /// Vertices that stand: base pose, and zeros.
    stands: Option<[Buffer; 2]>,
    vertices: usize,
}

/// A part, as a range of the index buffer.
pub(crate) struct Drawn {
    pub(crate) indices: Range<u32>,
    pub(crate) material: crate::Material,
    pub(crate) ball: Option<Vec4>,
    pub(crate) colour: [f32; 3],
    pub(crate) double_sided: bool,
}

impl Model {
    /// Makes the model of `mesh`, which was packed as `layout` and uploaded as `uploaded`. `parts` assign materials to
    /// triangles ([`parts`](crate::parts)); triangles in no part are not drawn.
    ///
    /// A vertex has the texture coordinates of its first corner; in a [split](deltamorph::MorphSource::split) source
    /// all its corners have the same.
    ///
    /// # Errors
    /// [`Error::Invalid`] if the layout is that of another mesh; an error if there is no memory.
    ///
    /// # Safety
    /// The model is dropped before `uploaded`, and only when no commands recorded with it are still to run.
    pub(crate) unsafe fn new(
        renderer: &Renderer,
        mesh: &MorphMesh,
        layout: &PackedLayout,
        uploaded: &GpuMesh,
        parts: &[Part],
    ) -> Result<Self> {
        let places = places_of(mesh, layout)?;
        let base = uploaded.base_pose();
        let padded = uploaded.base_pose().size as usize / 24;
        let block = layout.blocks.as_ref().map_or(padded.max(1), |blocks| blocks.size()) as u32;
        Self::placed(renderer, mesh, parts, places, ((base.buffer, base.offset), padded, block))
    }

    /// Draws `mesh`, made of `parts`, with each head: it stands as it is, relative to the head, without a pose.
    ///
    /// # Errors
    /// There is no memory.
    pub(crate) fn set_still(&mut self, renderer: &Renderer, mesh: &MorphMesh, parts: &[Part]) -> Result<()> {
        let gpu = &renderer.gpu;
        let vertices = vk::BufferUsageFlags::VERTEX_BUFFER;
        let base: Vec<Vec3> = mesh.positions.iter().zip(&mesh.normals).flat_map(|(p, n)| [*p, *n]).collect();
        let stands = [&base, &vec![Vec3::ZERO; base.len()]].map(|all| Buffer::filled(gpu, cast_slice(all), vertices));
        let [base, zeros] = stands;
        let stands = [base?, zeros?];
        let count = mesh.vertex_count();
        let base = (stands[0].raw, 0);
        let places = (0..count as u32).collect();
        let still = Self::placed(renderer, mesh, parts, places, (base, count, count.max(1) as u32))?;
        self.still = Some(Box::new(Self { stands: Some(stands), ..still }));
        Ok(())
    }

    /// Returns a head as it is drawn with this model, of still parts.
    pub(crate) fn standing(&self, renderer: &Renderer, head: &Head) -> Option<Head> {
        let [base, zeros] = self.stands.as_ref()?;
        // Integers are the displacement from the base pose.
        let pose = if renderer.desc.pose.has_integers() { zeros } else { base };
        let (buffer, offset) = head.still.unwrap_or((pose.raw, 0));
        let masks = head.masks.map(|_| Masks { buffer: zeros.raw, offset: 0, units: [1.0; 2] });
        Some(Head { buffer, offset, units: [1.0; 2], previous: (buffer, offset), masks, ..*head })
    }

    /// Returns the vertices of still parts as they stand.
    pub(crate) fn standing_vertices(&self) -> Vec<f32> {
        self.stands.as_ref().map_or(vec![], |[base, _]| cast_slice(&base.contents()[..24 * self.vertices]).to_vec())
    }

    fn placed(
        renderer: &Renderer,
        mesh: &MorphMesh,
        parts: &[Part],
        places: Vec<u32>,
        (base, padded, block): ((vk::Buffer, u64), usize, u32),
    ) -> Result<Self> {
        let count = mesh.vertex_count();
        let render = mesh.faces.render_vertices(&mesh.positions, &mesh.texcoords)?;
        let mut indices = vec![];
        let mut drawn = vec![];
        for part in parts {
            let begin = indices.len() as u32;
            indices.extend(part.triangles.iter().flatten().map(|&v| places[v as usize]));
            drawn.push(Drawn {
                indices: begin..indices.len() as u32,
                material: part.material,
                ball: part.ball,
                colour: part.surface.map_or([1.0; 3], |surface| surface.colour),
                double_sided: part.surface.is_none_or(|surface| surface.double_sided),
            });
        }
        let edges: Vec<u32> = edges(mesh, parts).into_iter().flatten().map(|v| places[v as usize]).collect();
        let corners = parts.iter().flat_map(|part| part.triangles.iter().flatten());
        let (low, high) = corners
            .map(|&v| mesh.positions[v as usize])
            .fold((Vec3::MAX, Vec3::MIN), |(low, high), p| (low.min(p), high.max(p)));
        let mut texcoords = vec![Vec2::ZERO; padded];
        places.iter().zip(&render.texcoords).for_each(|(&place, &texcoord)| texcoords[place as usize] = texcoord);
        let gpu = &renderer.gpu;
        let vertices = vk::BufferUsageFlags::VERTEX_BUFFER;
        let filled = |indices: &[u32]| Buffer::filled(gpu, cast_slice(indices), vk::BufferUsageFlags::INDEX_BUFFER);
        Ok(Self {
            indices: filled(&indices)?,
            edges: (filled(&edges)?, edges.len() as u32),
            texcoords: Buffer::filled(gpu, cast_slice(&texcoords), vertices)?,
            base,
            parts: drawn,
            middle: ((low + high) / 2.0).extend((low.distance(high) / 2.0).max(f32::MIN_POSITIVE)),
            pieces: pieces_of(padded),
            block,
            still: None,
            stands: None,
            vertices: count,
        })
    }
}

/// Returns the index of each vertex of a mesh in the pose buffers of its packed mesh.
pub(crate) fn places_of(mesh: &MorphMesh, layout: &PackedLayout) -> Result<Vec<u32>> {
    let count = mesh.vertex_count();
    if count != layout.vertex_count {
        return Err(Error::Invalid {
            what: format!("a mesh of {count} vertices, and the layout of one of {}", layout.vertex_count),
            remedy: "give the layout of the packed mesh".into(),
        });
    }
    let mut places: Vec<u32> = (0..count as u32).collect();
    layout.remap_indices(&mut places)?;
    Ok(places)
}

/// Returns the edges of the faces that `parts` draw, without diagonals, each once, from the lower vertex to the higher.
fn edges(mesh: &MorphMesh, parts: &[Part]) -> Vec<[u32; 2]> {
    let around = |corners: &[u32]| -> Vec<[u32; 2]> {
        let next = corners.iter().cycle().skip(1);
        corners.iter().zip(next).map(|(a, b)| [*a.min(b), *a.max(b)]).collect()
    };
    let triangles = parts.iter().flat_map(|part| &part.triangles);
    let drawn: HashSet<[u32; 2]> = triangles.flat_map(|triangle| around(triangle)).collect();
    let faces = mesh.faces.iter().map(|face| face.iter().map(|corner| corner.position).collect::<Vec<u32>>());
    let edges = faces.flat_map(|corners| around(&corners)).filter(|edge| drawn.contains(edge));
    edges.collect::<BTreeSet<_>>().into_iter().collect()
}
