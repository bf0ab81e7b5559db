//! What a glTF file says of surfaces: base colours of faces, and the parts that nothing moves.

use crate::output::Failure;
use deltamorph::import::gltf::{self, Drawn, DrawnPart, Property, Skeleton};
use deltamorph::{MorphMesh, Tolerance};
use deltamorph_render::{Face, Material, Part, Surface, parts};
use glam::DVec3;
use std::path::Path;

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

/// The parts of `mesh`, which was read from the glTF file at `path`, and those beside it; `unposed`: joints move them.
pub fn of_file(path: &Path, mesh: &MorphMesh, unposed: bool) -> Result<Painted, Failure> {
    let mut read = gltf::read(path)?;
    let mut channels = read.animations.iter().flat_map(|animation| &animation.channels);
    let has_joints = read.nodes.iter().any(|node| node.skin.is_some())
        || channels.any(|channel| channel.property != Property::Weights);
    let materials = std::mem::take(&mut read.materials);
    let gltf::Scene { mesh: drawn, still, .. } = read.into_scene(unposed)?;
    // The name of a single part says what the whole is.
    let is_named = drawn.parts.len() + still.as_ref().map_or(0, |still| still.parts.len()) > 1;
    let of = |drawn: &Drawn, mesh: &MorphMesh| {
        let material = |part: &DrawnPart| part.material.and_then(|number| materials.get(number));
        let name = |part: &DrawnPart| match is_named {
            true => format!("{} {}", part.name, material(part).map_or("", |material| &material.name)),
            false => String::new(),
        };
        let names: Vec<String> = drawn.parts.iter().map(name).collect();
        let mut said = vec![Face::Named(""); mesh.faces.sizes.len()];
        for (part, name) in drawn.parts.iter().zip(&names) {
            said[part.faces.clone()].fill(face(material(part), name));
        }
        parts(mesh, &said)
    };
    let parts = of(&drawn, mesh);
    let still = still.map(|mut still| -> Result<Still, Failure> {
        let mut stands = std::mem::take(&mut still.source).to_mesh(Tolerance::ZERO)?;
        stands.positions.iter_mut().for_each(|p| *p = (p.as_dvec3() - mesh.origin.as_dvec3()).as_vec3());
        Ok(Still { parts: of(&still, &stands), mesh: stands })
    });
    Ok(Painted { parts, has_joints, still: still.transpose()? })
}

/// What is drawn of a part whose material is `material`: its colour, or what its name says where a texture has the
/// colour.
fn face<'a>(material: Option<&gltf::Material>, name: &'a str) -> Face<'a> {
    match material {
        Some(material) if !material.is_textured && !material.is_opaque && material.base_color[3] < 1.0 => Face::Clear,
        Some(material) if !material.is_textured => {
            let [red, green, blue, _] = material.base_color;
            Face::Painted(Surface { colour: [red, green, blue], double_sided: material.double_sided })
        }
        // Opaque parts are drawn, whatever they are called.
        material if material.is_none_or(|material| material.is_opaque) && Material::from_name(name).is_none() => {
            Face::Named("")
        }
        _ => Face::Named(name),
    }
}

impl Still {
    /// Position and normal of each vertex where joints have these matrices.
    pub fn skinned(&self, skeleton: &Skeleton, matrices: &[glam::DMat4]) -> Vec<f32> {
        let influences = &skeleton.influences;
        let mut vertices = Vec::with_capacity(6 * self.mesh.vertex_count());
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
