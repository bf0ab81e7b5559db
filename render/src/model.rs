//! The static data of a drawn mesh: indices and parts.

use crate::memory::{self, Buffer};
use crate::parts::Part;
use crate::renderer::Renderer;
use crate::scene::{Head, Masks, Scale};
use bytemuck::cast_slice;
use deltamorph::ash::vk;
use deltamorph::{Error, KeptMesh, POSE_FLOATS, PackedLayout, PoseFormat, Result};
use glam::{Vec3, Vec4};
use std::collections::{BTreeSet, HashSet};
use std::ops::Range;

/// An uploaded mesh, with the data to draw it.
pub struct Model {
    pub indices: Buffer,
    /// Two vertices for each edge of a face.
    pub edges: (Buffer, u32),
    /// Float32 position and normal of each vertex as it is without weights, in the order of poses.
    pub rest: Buffer,
    pub parts: Vec<Drawn>,
    /// Middle of the box around the drawn part of the base pose, and half its diagonal.
    pub middle: Vec4,
    /// Vertices per block; for dense formats, of the mesh.
    pub block: u32,
    /// Parts that nothing moves.
    pub still: Option<Box<Model>>,
    /// Of still parts: their vertices as a pose in the renderer's format.
    stands: Option<(Buffer, Scale)>,
}

/// A part, as a range of the index buffer.
pub struct Drawn {
    pub indices: Range<u32>,
    pub material: crate::Material,
    pub ball: Option<Vec4>,
    pub colour: [f32; 3],
    pub double_sided: bool,
}

impl Model {
    /// Makes the model of `mesh`, which was packed as `layout`. `parts` assign materials to
    /// triangles ([`parts`](crate::parts)); triangles in no part are not drawn.
    ///
    /// # Errors
    /// [`Error::Invalid`] if the layout is that of another mesh; an error if there is no memory.
    ///
    /// # Safety
    /// The model is dropped only when no commands recorded with it are still to run.
    pub unsafe fn new(renderer: &Renderer, mesh: &KeptMesh, layout: &PackedLayout, parts: &[Part]) -> Result<Self> {
        let places = places_of(mesh, layout)?;
        let padded = layout.padded_vertices();
        let block = layout.blocks.as_ref().map_or(padded.max(1), |blocks| blocks.size()) as u32;
        Self::placed(renderer, mesh, parts, places, (padded, block))
    }

    /// Draws `mesh`, made of `parts`, with each head: it stands as it is, relative to the head, without a pose.
    ///
    /// # Errors
    /// There is no memory.
    pub fn set_still(&mut self, renderer: &Renderer, mesh: &KeptMesh, parts: &[Part]) -> Result<()> {
        let count = mesh.vertex_count();
        let places: Vec<u32> = (0..count as u32).collect();
        let rest = at_rest(mesh, &places, count);
        let (bytes, scale) = stored(renderer.pose, &rest);
        let pose = memory::filled(&renderer.gpu, &bytes, vk::BufferUsageFlags::VERTEX_BUFFER)?;
        let still = Self::placed(renderer, mesh, parts, places, (count, count.max(1) as u32))?;
        self.still = Some(Box::new(Self { stands: Some((pose, scale)), ..still }));
        Ok(())
    }

    /// Returns a head as it is drawn with this model, of still parts.
    pub fn standing(&self, head: &Head) -> Option<Head> {
        let (pose, scale) = self.stands.as_ref()?;
        let (buffer, offset) = (pose.raw, 0);
        // Whatever the numbers, the masks are 0.
        let masks = head.masks.map(|_| Masks { buffer: pose.raw, offset: 0, scale: [0.0; 4] });
        Some(Head { buffer, offset, scale: *scale, previous: (buffer, offset), masks, ..*head })
    }

    fn placed(
        renderer: &Renderer,
        mesh: &KeptMesh,
        parts: &[Part],
        places: Vec<u32>,
        (padded, block): (usize, u32),
    ) -> Result<Self> {
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
        let gpu = &renderer.gpu;
        let filled = |indices: &[u32]| memory::filled(gpu, cast_slice(indices), vk::BufferUsageFlags::INDEX_BUFFER);
        Ok(Self {
            indices: filled(&indices)?,
            edges: (filled(&edges)?, edges.len() as u32),
            rest: memory::filled(
                gpu,
                cast_slice(&at_rest(mesh, &places, padded)),
                vk::BufferUsageFlags::VERTEX_BUFFER,
            )?,
            parts: drawn,
            middle: ((low + high) / 2.0).extend((low.distance(high) / 2.0).max(f32::MIN_POSITIVE)),
            block,
            still: None,
            stands: None,
        })
    }
}

/// Position and normal of the vertices of a mesh, which are at `places`.
fn at_rest(mesh: &KeptMesh, places: &[u32], padded: usize) -> Vec<f32> {
    let mut rest = vec![0.0; padded * POSE_FLOATS];
    for ((place, position), normal) in places.iter().zip(&mesh.positions).zip(&mesh.normals) {
        let vertex = &mut rest[*place as usize * POSE_FLOATS..][..POSE_FLOATS];
        vertex[..3].copy_from_slice(&position.to_array());
        vertex[3..].copy_from_slice(&normal.to_array());
    }
    rest
}

/// Vertices as a pose, and what its attributes stand for: integers as fine as they can be.
fn stored(pose: PoseFormat, vertices: &[f32]) -> (Vec<u8>, Scale) {
    if !pose.has_integers() {
        return (cast_slice(vertices).to_vec(), Scale::ONE);
    }
    let is_16 = pose.stride() == 12;
    let most = if is_16 { f64::from(i16::MAX) } else { f64::from(i32::MAX) };
    let mut units = [1.0; POSE_FLOATS];
    for (c, unit) in units.iter_mut().enumerate() {
        // The components of a normal have one unit.
        let alike = if c < 3 { c..c + 1 } else { 3..POSE_FLOATS };
        let of = vertices.chunks_exact(POSE_FLOATS).flat_map(|vertex| &vertex[alike.clone()]);
        let largest = of.fold(f32::MIN_POSITIVE, |most, number| most.max(number.abs()));
        *unit = ((f64::from(largest) / most) as f32).next_up();
    }
    let integers = vertices.iter().enumerate().map(|(i, number)| {
        let exact = f64::from(*number) / f64::from(units[i % POSE_FLOATS]);
        exact.round() as i32
    });
    let bytes = if is_16 {
        integers.flat_map(|integer| (integer as i16).to_ne_bytes()).collect()
    } else {
        integers.flat_map(i32::to_ne_bytes).collect()
    };
    (bytes, Scale { scale: units, offsets: [0.0; POSE_FLOATS] })
}

/// Returns the index of each vertex of a mesh in the pose buffers of its packed mesh.
pub fn places_of(mesh: &KeptMesh, layout: &PackedLayout) -> Result<Vec<u32>> {
    let count = mesh.vertex_count();
    if count != layout.vertex_count {
        return Err(Error::invalid(
            format!("a mesh of {count} vertices, and the layout of one of {}", layout.vertex_count),
            "give the layout of the packed mesh",
        ));
    }
    let mut places: Vec<u32> = (0..count as u32).collect();
    layout.remap_indices(&mut places)?;
    Ok(places)
}

/// Returns the edges of the faces that `parts` draw, without diagonals, each once, from the lower vertex to the higher.
fn edges(mesh: &KeptMesh, parts: &[Part]) -> Vec<[u32; 2]> {
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
