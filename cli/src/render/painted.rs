//! What a glTF file says of surfaces: base colours of faces, and the parts that nothing moves.

use crate::output::{Failure, Output};
use deltamorph::import::gltf::{self, Drawn, Property, Skeleton};
use deltamorph::{MorphMesh, Tolerance};
use deltamorph_render::{Material, Part, Pixels, Surface, painted};
use glam::DVec3;
use std::path::Path;
use std::sync::Arc;

/// Parts of a file, by their surfaces.
pub struct Painted {
    pub parts: Vec<Part>,
    /// Whether the file has joints, or nodes that move.
    pub has_joints: bool,
    pub still: Option<Still>,
}

/// What no target moves.
pub struct Still {
    /// Relative to the origin of the mesh that targets move.
    pub mesh: MorphMesh,
    pub parts: Vec<Part>,
}

/// What the file says of a material.
enum Paint {
    Stated(Arc<Surface>),
    /// Its texture cannot be read; whether it covers what it is on.
    Lost {
        covers: bool,
    },
}

/// The parts of `mesh`, which was read from the glTF file at `path`, and those beside it; `unposed`: joints move them.
pub fn of_file(path: &Path, mesh: &MorphMesh, unposed: bool, out: &Output) -> Result<Painted, Failure> {
    let read = gltf::read(path)?;
    let mut channels = read.animations.iter().flat_map(|animation| &animation.channels);
    let has_joints = read.nodes.iter().any(|node| node.skin.is_some())
        || channels.any(|channel| channel.property != Property::Weights);
    let gltf::Scene { mesh: drawn, still, .. } = read.into_scene(unposed)?;
    let paints = paints(path, out)?;
    // The name of a single part says what the whole is.
    let is_named = drawn.parts.len() + still.as_ref().map_or(0, |still| still.parts.len()) > 1;
    let of = |drawn: &Drawn, mesh: &MorphMesh| {
        let (mut names, mut surfaces) =
            (vec![String::new(); mesh.faces.sizes.len()], vec![None; mesh.faces.sizes.len()]);
        for part in &drawn.parts {
            let paint = part.material.and_then(|material| paints.get(material));
            let (name, covers) = match paint {
                Some((_, Paint::Stated(surface))) => {
                    surfaces[part.faces.clone()].fill(Some(surface.clone()));
                    continue;
                }
                Some((name, Paint::Lost { covers })) => (name.as_str(), *covers),
                None => ("", true),
            };
            let name = format!("{} {name}", part.name);
            if is_named && !(covers && Material::from_name(&name).is_none()) {
                names[part.faces.clone()].fill(name);
            }
        }
        painted(mesh, &names, &surfaces)
    };
    let parts = of(&drawn, mesh);
    let still = still.map(|mut still| -> Result<Still, Failure> {
        let mut stands = std::mem::take(&mut still.source).to_mesh(Tolerance::ZERO)?;
        stands.positions.iter_mut().for_each(|p| *p = (p.as_dvec3() - mesh.origin.as_dvec3()).as_vec3());
        Ok(Still { parts: of(&still, &stands), mesh: stands })
    });
    Ok(Painted { parts, has_joints, still: still.transpose()? })
}

/// The names and surfaces of all materials.
fn paints(path: &Path, out: &Output) -> Result<Vec<(String, Paint)>, Failure> {
    let read = gltf::read_materials(path)?;
    read.notes.iter().for_each(|note| out.note(note));
    let decode = |(number, bytes): (usize, &Vec<u8>)| {
        if bytes.is_empty() {
            return None;
        }
        match image::load_from_memory(bytes) {
            Ok(image) => {
                let image = image.into_rgba8();
                Some(Arc::new(Pixels { size: [image.width(), image.height()], rgba: image.into_raw() }))
            }
            Err(error) => {
                out.note(format_args!("images[{number}] is no PNG or JPEG that can be read ({error}): left out"));
                None
            }
        }
    };
    let images: Vec<Option<Arc<Pixels>>> = read.images.iter().enumerate().map(decode).collect();
    let paint = |material: &gltf::Material| {
        let mut place = Default::default();
        let texture = match &material.texture {
            None => None,
            Some(texture) => {
                let pixels = texture.image.and_then(|image| images.get(image)?.clone());
                // Poses have one set of texture coordinates.
                let Some(pixels) = pixels.filter(|_| texture.texcoord == 0) else {
                    if texture.texcoord > 0 {
                        let name = &material.name;
                        out.note(format_args!("material '{name}': its texture is on further coordinates: left out"));
                    }
                    return Paint::Lost { covers: material.alpha == gltf::Alpha::Opaque };
                };
                place = texture.transform;
                Some((pixels, texture.wrap))
            }
        };
        let gltf::Material { base_color: colour, alpha, double_sided, .. } = *material;
        Paint::Stated(Arc::new(Surface { colour, texture, place, alpha, double_sided }))
    };
    Ok(read.materials.iter().map(|material| (material.name.clone(), paint(material))).collect())
}

impl Still {
    /// Position and normal of each vertex where joints have these matrices.
    pub fn skinned(&self, skeleton: &Skeleton, matrices: &[glam::DMat4]) -> Vec<f32> {
        let (influences, mut vertices) = (&skeleton.influences, Vec::with_capacity(6 * self.mesh.vertex_count()));
        for (v, (p, n)) in self.mesh.positions.iter().zip(&self.mesh.normals).enumerate() {
            let matrix = influences.blend(v, matrices);
            let [x, y, z] = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(|axis| axis.truncate());
            // The inverse transpose, but for its scale.
            let sign = if x.cross(y).dot(z) < 0.0 { -1.0 } else { 1.0 };
            let n = n.as_dvec3();
            let turned: DVec3 = (y.cross(z) * n.x + z.cross(x) * n.y + x.cross(y) * n.z) * sign;
            let vertex = [matrix.transform_point3(p.as_dvec3()), turned.normalize_or(n)];
            vertices.extend(vertex.iter().flat_map(|vector| vector.as_vec3().to_array()));
        }
        vertices
    }
}
