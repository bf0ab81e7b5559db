//! The static data of a drawn mesh: indices, texture coordinates, parts.

use crate::glow::pieces_of;
use crate::memory::Buffer;
use crate::parts::Part;
use crate::renderer::Renderer;
use crate::scene::{Head, Masks};
use crate::surface::{Surface, Textures};
use bytemuck::cast_slice;
use deltamorph::ash::vk;
use deltamorph::import::gltf::Alpha;
use deltamorph::{Error, GpuMesh, MorphMesh, PackedLayout, Result};
use glam::{Affine2, Vec2, Vec3, Vec4};
use std::collections::{BTreeSet, HashSet};
use std::ops::Range;
use std::sync::Arc;

/// An uploaded mesh, with the data to draw it.
pub struct Model {
    pub(crate) indices: Buffer,
    /// Two vertices for each edge of a face.
    pub(crate) edges: (Buffer, u32),
    pub(crate) texcoords: Buffer,
    pub(crate) values: Buffer,
    pub(crate) base: (vk::Buffer, u64),
    pub(crate) parts: Vec<Drawn>,
    /// Middle of the box around the drawn part of the base pose, and half its diagonal.
    pub(crate) middle: Vec4,
    /// Number of pieces in a [`Glow`](crate::Glow).
    pub(crate) pieces: usize,
    /// Vertices per block; for dense formats, of the mesh.
    pub(crate) block: u32,
    pub(crate) textures: Textures,
    /// Parts that nothing moves.
    pub(crate) still: Option<Box<Model>>,
    /// Vertices that stand: base pose, and zeros.
    stands: Option<[Buffer; 2]>,
    /// For each vertex of the mesh, its index in pose buffers.
    places: Vec<u32>,
}

/// A part, as a range of the index buffer.
pub(crate) struct Drawn {
    pub(crate) indices: Range<u32>,
    pub(crate) material: crate::Material,
    pub(crate) ball: Option<Vec4>,
    pub(crate) colour: [f32; 4],
    pub(crate) uv: Affine2,
    /// 0: opaque; above: less opacity is not drawn; below: what is behind shows through.
    pub(crate) cutoff: f32,
    pub(crate) double_sided: bool,
    /// Index of the texture's set.
    pub(crate) texture: usize,
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
    pub unsafe fn new(
        renderer: &Renderer,
        mesh: &MorphMesh,
        layout: &PackedLayout,
        uploaded: &GpuMesh,
        parts: &[Part],
    ) -> Result<Self> {
        let places = places_of(mesh, layout)?;
        let (base, padded) = (uploaded.base_pose(), uploaded.base_pose().size as usize / 24);
        let block = layout.blocks.as_ref().map_or(padded.max(1), |blocks| blocks.size()) as u32;
        Self::placed(renderer, mesh, parts, places, ((base.buffer, base.offset), padded, block))
    }

    /// Draws `mesh`, made of `parts`, with each head: it stands as it is, relative to the head, without a pose.
    ///
    /// # Errors
    /// There is no memory.
    pub fn set_still(&mut self, renderer: &Renderer, mesh: &MorphMesh, parts: &[Part]) -> Result<()> {
        let (gpu, vertices) = (&renderer.gpu, vk::BufferUsageFlags::VERTEX_BUFFER);
        let base: Vec<Vec3> = mesh.positions.iter().zip(&mesh.normals).flat_map(|(p, n)| [*p, *n]).collect();
        let stands = [&base, &vec![Vec3::ZERO; base.len()]].map(|all| Buffer::filled(gpu, cast_slice(all), vertices));
        let [base, zeros] = stands;
        let stands = [base?, zeros?];
        let (count, base) = (mesh.vertex_count(), (stands[0].raw, 0));
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
        self.stands.as_ref().map_or(vec![], |[base, _]| cast_slice(&base.contents()[..24 * self.places.len()]).to_vec())
    }

    fn placed(
        renderer: &Renderer,
        mesh: &MorphMesh,
        parts: &[Part],
        places: Vec<u32>,
        (base, padded, block): ((vk::Buffer, u64), usize, u32),
    ) -> Result<Self> {
        let count = mesh.vertex_count();
        let surfaces: Vec<Arc<Surface>> = parts.iter().filter_map(|part| part.surface.clone()).collect();
        let (textures, sets) = Textures::new(renderer, &surfaces)?;
        let mut sets = sets.into_iter();
        let render = mesh.faces.render_vertices(count, &mesh.texcoords)?;
        let (mut indices, mut drawn) = (vec![], vec![]);
        for part in parts {
            let begin = indices.len() as u32;
            indices.extend(part.triangles.iter().flatten().map(|&v| places[v as usize]));
            let range = begin..indices.len() as u32;
            let (material, ball, surface) = (part.material, part.ball, part.surface.as_ref());
            drawn.push(Drawn {
                indices: range,
                material,
                ball,
                colour: surface.map_or([1.0; 4], |surface| surface.colour),
                uv: surface.map_or(Affine2::IDENTITY, |surface| surface.place),
                cutoff: surface.map_or(0.0, |surface| match surface.alpha {
                    Alpha::Opaque => 0.0,
                    Alpha::Mask(cutoff) => cutoff.max(0.0),
                    Alpha::Blend => -1.0,
                }),
                double_sided: surface.is_none_or(|surface| surface.double_sided),
                texture: surface.and_then(|_| sets.next()).unwrap_or(0),
            });
        }
        let edges: Vec<u32> = edges(mesh, parts).into_iter().flatten().map(|v| places[v as usize]).collect();
        let corners = parts.iter().flat_map(|part| part.triangles.iter().flatten());
        let (low, high) = corners
            .map(|&v| mesh.positions[v as usize])
            .fold((Vec3::MAX, Vec3::MIN), |(low, high), p| (low.min(p), high.max(p)));
        let mut texcoords = vec![Vec2::ZERO; padded];
        places.iter().zip(&render.texcoords).for_each(|(&place, &texcoord)| texcoords[place as usize] = texcoord);
        let (gpu, vertices) = (&renderer.gpu, vk::BufferUsageFlags::VERTEX_BUFFER);
        let filled = |indices: &[u32]| Buffer::filled(gpu, cast_slice(indices), vk::BufferUsageFlags::INDEX_BUFFER);
        Ok(Self {
            indices: filled(&indices)?,
            edges: (filled(&edges)?, edges.len() as u32),
            texcoords: Buffer::filled(gpu, cast_slice(&texcoords), vertices)?,
            values: Buffer::new(gpu, 4 * padded.max(1), vertices, false)?,
            base,
            parts: drawn,
            middle: ((low + high) / 2.0).extend((low.distance(high) / 2.0).max(f32::MIN_POSITIVE)),
            pieces: pieces_of(padded),
            block,
            textures,
            still: None,
            stands: None,
            places,
        })
    }

    /// Sets the value of each vertex of the mesh, in the mesh's order, for [`Show::Values`](crate::Show::Values). No
    /// commands that draw the model may still be pending.
    ///
    /// # Errors
    /// [`Error::Invalid`] if the number of values is not that of vertices.
    pub fn set_values(&mut self, values: &[f32]) -> Result<()> {
        if values.len() != self.places.len() {
            return Err(Error::Invalid {
                what: format!("{} values for {} vertices", values.len(), self.places.len()),
                remedy: "give one for each vertex of the mesh".into(),
            });
        }
        let most = self.places.iter().max().map_or(0, |&place| place as usize + 1);
        let mut placed = vec![0f32; most];
        self.places.iter().zip(values).for_each(|(&place, &value)| placed[place as usize] = value);
        self.values.write(0, cast_slice(&placed));
        Ok(())
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
