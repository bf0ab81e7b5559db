//! What a glTF file says of surfaces: base colours of faces, and the parts that nothing moves.

use crate::output::Result;
use deltamorph::import::gltf::{self, Drawn, DrawnPart};
use deltamorph::{KeptMesh, Tolerance};
use deltamorph_render::{Face, Material, Part, Surface, parts};
use std::path::Path;

/// Parts of a file, by their surfaces.
pub struct Painted {
    pub parts: Vec<Part>,
    pub still: Option<Still>,
}

/// What no target moves.
pub struct Still {
    /// Relative to the origin of the mesh that targets move.
    pub mesh: KeptMesh,
    pub parts: Vec<Part>,
}

/// The parts of `mesh`, which was read from the glTF file at `path`, and those beside it, with joints at rest.
pub fn of_file(path: &Path, mesh: &KeptMesh) -> Result<Painted> {
    let mut read = gltf::read(path)?;
    let materials = std::mem::take(&mut read.materials);
    let gltf::Scene { mesh: drawn, still } = read.into_scene()?;
    // The name of a single part says what the whole is.
    let is_named = drawn.parts.len() + still.as_ref().map_or(0, |still| still.parts.len()) > 1;
    let of = |drawn: &Drawn, mesh: &KeptMesh| {
        let material = |part: &DrawnPart| part.material.and_then(|number| materials.get(number));
        let name = |part: &DrawnPart| {
            if is_named {
                format!("{} {}", part.name, material(part).map_or("", |material| &material.name))
            } else {
                String::new()
            }
        };
        let names: Vec<String> = drawn.parts.iter().map(name).collect();
        let mut said = vec![Face::Named(""); mesh.faces.sizes.len()];
        for (part, name) in drawn.parts.iter().zip(&names) {
            said[part.faces.clone()].fill(face(material(part), name));
        }
        parts(mesh, &said)
    };
    let parts = of(&drawn, mesh);
    let still = still.map(|mut still| -> Result<Still> {
        let mut stands = std::mem::take(&mut still.source).kept(Tolerance::ZERO)?;
        stands.positions.iter_mut().for_each(|p| *p = (p.as_dvec3() - mesh.origin.as_dvec3()).as_vec3());
        Ok(Still { parts: of(&still, &stands), mesh: stands })
    });
    Ok(Painted { parts, still: still.transpose()? })
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
