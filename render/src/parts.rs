//! The materials of a mesh: skin, eyes, teeth. They follow from the names of groups or materials in the file; without
//! names, eyeballs are recognised by their shape.

use deltamorph::KeptMesh;
use glam::{Mat3, Vec3, Vec4};
use std::collections::HashMap;

/// The material of a part. The numbers are those of glsl/scene.glsl.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum Material {
    /// Skin, and everything that is not recognised.
    Skin = 0,
    /// An eyeball.
    Eye = 1,
    /// Teeth.
    Teeth = 2,
    /// Tongue, gums, the inside of the mouth.
    Mouth = 3,
    /// A surface that the file states ([`Part::surface`]).
    Painted = 5,
}

impl Material {
    /// Returns the probable material of a group or material with this name; `None` if it is transparent, and not drawn
    /// (tears, the shadow over an eye; lashes and brows, which are cards with a texture of hairs).
    pub fn from_name(name: &str) -> Option<Self> {
        let name = name.to_lowercase();
        let has = |words: &[&str]| words.iter().any(|word| name.contains(word));
        if has(&["occlusion", "lacrimal", "fluid", "tear", "eyeblend", "cornea", "lash", "brow", "hair"]) {
            return None;
        }
        Some(match () {
            () if has(&["gum", "tongue", "mouth"]) => Self::Mouth,
            () if has(&["teeth", "tooth"]) => Self::Teeth,
            () if has(&["eyelid", "eyesocket"]) => Self::Skin,
            () if has(&["eye", "sclera", "iris", "pupil"]) => Self::Eye,
            () => Self::Skin,
        })
    }
}

/// A surface that a file states.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Linear red, green and blue.
    pub colour: [f32; 3],
    /// Whether back faces are drawn, too, lit from their own side.
    pub double_sided: bool,
}

/// What a file says of a face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Face<'a> {
    /// The name of its group or material, which may be empty ([`Material::from_name`]).
    Named(&'a str),
    /// Its surface.
    Painted(Surface),
    /// It is transparent, and not drawn.
    Clear,
}

/// Triangles of one material.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// The material.
    pub material: Material,
    /// Three vertices of the mesh for each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Middle and radius of an eyeball in the base pose; `None` for other parts.
    pub ball: Option<Vec4>,
    /// The surface, for [`Material::Painted`]; without one it is white.
    pub surface: Option<Surface>,
}

/// Returns the parts of a mesh. `said` has what the file says of each face, or is empty: eyeballs are then recognised
/// by their shape, and everything else is skin.
pub fn parts(mesh: &KeptMesh, said: &[Face<'_>]) -> Vec<Part> {
    let mut kinds: HashMap<&str, Option<Material>> = HashMap::new();
    let mut faces: Vec<(Option<Material>, [u32; 3])> = vec![];
    let mut stated: Vec<Part> = vec![];
    let mut all = mesh.faces.triangles(&mesh.positions).into_iter();
    for (i, corners) in mesh.faces.sizes.iter().enumerate() {
        let triangles: Vec<[u32; 3]> = all.by_ref().take(*corners as usize - 2).collect();
        let material = match said.get(i) {
            None => Some(Material::Skin),
            Some(Face::Named(name)) => *kinds.entry(name).or_insert_with(|| Material::from_name(name)),
            Some(Face::Clear) => continue,
            Some(Face::Painted(surface)) => {
                let surface = Some(*surface);
                match stated.iter_mut().find(|part| part.surface == surface) {
                    Some(part) => part.triangles.extend(triangles),
                    None => stated.push(Part { material: Material::Painted, triangles, ball: None, surface }),
                }
                continue;
            }
        };
        faces.extend(triangles.into_iter().map(|triangle| (material, triangle)));
    }
    let named = faces.iter().any(|(material, _)| *material != Some(Material::Skin));
    let pieces = pieces(mesh, &faces);
    let mut parts: Vec<Part> = vec![];
    let eyeball = |triangles: &Vec<[u32; 3]>| sphere(mesh, triangles).filter(|ball| is_eyeball(mesh, triangles, ball));
    let is_eye = |material: &Option<Material>| *material == Some(Material::Eye);
    let some_are_whole = pieces.iter().any(|(material, triangles)| is_eye(material) && eyeball(triangles).is_some());
    for (material, triangles) in &pieces {
        // If no eye is whole, what is called one may be the part that is seen, or all of a mesh of eyes.
        let cap = || sphere(mesh, triangles).filter(|ball| roughness(mesh, triangles, ball) < 0.15);
        let ball = eyeball(triangles).or_else(|| cap().filter(|_| is_eye(material) && !some_are_whole));
        let (material, ball) = match (material, ball) {
            (None, _) => continue,
            (Some(Material::Skin), Some(ball)) if !named => (Material::Eye, Some(ball)),
            (Some(Material::Eye), ball) => (Material::Eye, ball),
            (Some(other), _) => (*other, None),
        };
        match parts.iter_mut().find(|part| part.material == material && part.ball == ball) {
            Some(part) => part.triangles.extend(triangles),
            None => parts.push(Part { material, triangles: triangles.clone(), ball, surface: None }),
        }
    }
    // A piece in front of an eyeball, such as a separate iris, belongs to the nearest eyeball.
    let balls: Vec<Vec4> = parts.iter().filter_map(|part| part.ball).collect();
    for part in parts.iter_mut().filter(|part| part.material == Material::Eye && part.ball.is_none()) {
        let middle = middle(mesh, &part.triangles);
        let off = |ball: &Vec4| ball.truncate().distance(middle);
        part.ball =
            balls.iter().copied().filter(|ball| off(ball) < 1.5 * ball.w).min_by(|a, b| off(a).total_cmp(&off(b)));
    }
    // Eyes come in pairs: a single ball may be a button.
    if !named && balls.len() < 2 {
        parts.iter_mut().for_each(|part| (part.material, part.ball) = (Material::Skin, None));
    }
    parts.extend(stated);
    parts
}

/// Groups triangles that are connected and have the same material.
fn pieces(mesh: &KeptMesh, faces: &[(Option<Material>, [u32; 3])]) -> Vec<(Option<Material>, Vec<[u32; 3]>)> {
    let welded = |v: u32| mesh.welds.get(v as usize).copied().unwrap_or(v);
    let mut parents: Vec<u32> = (0..mesh.vertex_count() as u32).collect();
    fn root(parents: &mut [u32], mut v: u32) -> u32 {
        while parents[v as usize] != v {
            parents[v as usize] = parents[parents[v as usize] as usize];
            v = parents[v as usize];
        }
        v
    }
    for (_, triangle) in faces {
        let [a, b, c] = triangle.map(|v| root(&mut parents, welded(v)));
        parents[b as usize] = a;
        let c = root(&mut parents, c);
        parents[c as usize] = a;
    }
    let mut numbers = HashMap::new();
    let mut pieces = vec![];
    for (material, triangle) in faces {
        let key = (root(&mut parents, welded(triangle[0])), *material);
        let at = *numbers.entry(key).or_insert_with(|| {
            pieces.push((*material, vec![]));
            pieces.len() - 1
        });
        pieces[at].1.push(*triangle);
    }
    pieces
}

fn positions<'a>(mesh: &'a KeptMesh, triangles: &'a [[u32; 3]]) -> impl Iterator<Item = Vec3> + 'a {
    triangles.iter().flatten().map(|&v| mesh.positions[v as usize])
}

fn middle(mesh: &KeptMesh, triangles: &[[u32; 3]]) -> Vec3 {
    positions(mesh, triangles).sum::<Vec3>() / (3 * triangles.len()).max(1) as f32
}

/// Fits a sphere to the corners, by least squares of |p|² − 2 c·p + (c² − r²); returns its middle and radius.
fn sphere(mesh: &KeptMesh, triangles: &[[u32; 3]]) -> Option<Vec4> {
    let origin = middle(mesh, triangles);
    let points = || positions(mesh, triangles).map(|p| p - origin);
    // With the points' mean as origin, the middle has its own equation: 2 (Σ p pᵀ) c = Σ |p|² p.
    let mut products = Mat3::ZERO;
    let mut right = Vec3::ZERO;
    let mut squares = 0.0;
    for p in points() {
        products += Mat3::from_cols(p * p.x, p * p.y, p * p.z);
        right += p * p.length_squared();
        squares += p.length_squared();
    }
    let count = 3.0 * triangles.len() as f32;
    let centre = (products * 2.0).inverse() * right;
    let radius = (squares / count + centre.length_squared()).sqrt();
    (triangles.len() >= 12 && centre.is_finite() && radius.is_finite()).then(|| (origin + centre).extend(radius))
}

/// Returns the mean distance of corners from a sphere, as a share of its radius.
fn roughness(mesh: &KeptMesh, triangles: &[[u32; 3]], ball: &Vec4) -> f32 {
    let off = positions(mesh, triangles).map(|p| (p.distance(ball.truncate()) / ball.w - 1.0).abs());
    off.sum::<f32>() / (3 * triangles.len()).max(1) as f32
}

/// Returns whether the corners lie on the sphere and cover most of it, and the sphere is as large as an eye.
fn is_eyeball(mesh: &KeptMesh, triangles: &[[u32; 3]], ball: &Vec4) -> bool {
    let radius = ball.w;
    let (low, high) = positions(mesh, triangles).fold((Vec3::MAX, Vec3::MIN), |(l, h), p| (l.min(p), h.max(p)));
    let size = (high - low).min_element() / radius;
    // The cornea bulges by an eighth.
    roughness(mesh, triangles, ball) < 0.06 && size > 0.9 && radius < 0.1 * mesh.diagonal
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltamorph_head::{HeadDesc, head};

    #[test]
    fn names_say_what_a_part_is_made_of() {
        let of = Material::from_name;
        for (name, expected) in [
            ("M_Face", Some(Material::Skin)),
            ("M_ScleraLeft", Some(Material::Eye)),
            ("M_EyeOcclusion", None),
            ("M_LacrimalFluid", None),
            ("M_EyeLashes", None),
            ("M_GumsTongue", Some(Material::Mouth)),
            ("helper-upper-teeth", Some(Material::Teeth)),
            ("helper-l-eyelashes-2", None),
            ("helper-r-eye", Some(Material::Eye)),
            ("body", Some(Material::Skin)),
        ] {
            assert_eq!(of(name), expected, "{name}");
        }
    }

    /// Surfaces of painted faces are looked at in tests/draw.rs.
    #[test]
    fn every_triangle_is_of_one_part_and_clear_ones_are_of_none() {
        let source = head(&HeadDesc { vertices: 600, targets: 1, ..Default::default() });
        let mesh = source.kept(Default::default()).expect("a mesh");
        let triangles = |face| {
            let mut said = vec![Face::Named(""); mesh.faces.sizes.len()];
            said[3..9].fill(face);
            parts(&mesh, &said).iter().map(|part| part.triangles.len()).sum::<usize>()
        };
        let painted = Face::Painted(Surface { colour: [1.0; 3], double_sided: true });
        assert!(triangles(Face::Named("")) == triangles(painted) && triangles(Face::Clear) < triangles(painted));
    }
}
