//! The materials of a mesh: skin, eyes, teeth. They follow from the names of groups or materials in the file; without
//! names, eyeballs are recognised by their shape.

use crate::surface::Surface;
use deltamorph::MorphMesh;
use glam::{Mat3, Vec3, Vec4};
use std::collections::HashMap;
use std::sync::Arc;

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
    pub surface: Option<Arc<Surface>>,
}

/// Returns the parts of a mesh. `names` has a name for each face, or is empty: eyeballs are then recognised by their
/// shape, and everything else is skin.
pub fn parts(mesh: &MorphMesh, names: &[impl AsRef<str>]) -> Vec<Part> {
    painted(mesh, names, &[])
}

/// Returns the parts of a mesh whose file states `surfaces`, one for each face or `None`; faces without one are as in
/// [`parts`].
pub fn painted(mesh: &MorphMesh, names: &[impl AsRef<str>], surfaces: &[Option<Arc<Surface>>]) -> Vec<Part> {
    let mut kinds: HashMap<&str, Option<Material>> = HashMap::new();
    let mut faces: Vec<(Option<Material>, [u32; 3])> = vec![];
    let (mut of_surface, mut stated): (HashMap<_, usize>, Vec<Part>) = Default::default();
    for (i, face) in mesh.faces.iter().enumerate() {
        let material = match names.get(i).map(AsRef::as_ref) {
            Some(name) => *kinds.entry(name).or_insert_with(|| Material::from_name(name)),
            None => Some(Material::Skin),
        };
        let corner = |i: usize| face[i].position;
        let triangles = (2..face.len()).map(|i| [corner(0), corner(i - 1), corner(i)]);
        if let Some(surface) = surfaces.get(i).and_then(Option::as_ref) {
            let at = *of_surface.entry(Arc::as_ptr(surface)).or_insert(stated.len());
            if at == stated.len() {
                let surface = Some(surface.clone());
                stated.push(Part { material: Material::Painted, triangles: vec![], ball: None, surface });
            }
            stated[at].triangles.extend(triangles);
            continue;
        }
        faces.extend(triangles.map(|triangle| (material, triangle)));
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
fn pieces(mesh: &MorphMesh, faces: &[(Option<Material>, [u32; 3])]) -> Vec<(Option<Material>, Vec<[u32; 3]>)> {
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
    let (mut numbers, mut pieces) = (HashMap::new(), vec![]);
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

fn positions<'a>(mesh: &'a MorphMesh, triangles: &'a [[u32; 3]]) -> impl Iterator<Item = Vec3> + 'a {
    triangles.iter().flatten().map(|&v| mesh.positions[v as usize])
}

fn middle(mesh: &MorphMesh, triangles: &[[u32; 3]]) -> Vec3 {
    positions(mesh, triangles).sum::<Vec3>() / (3 * triangles.len()).max(1) as f32
}

/// Fits a sphere to the corners, by least squares of |p|² − 2 c·p + (c² − r²); returns its middle and radius.
fn sphere(mesh: &MorphMesh, triangles: &[[u32; 3]]) -> Option<Vec4> {
    let origin = middle(mesh, triangles);
    let points = || positions(mesh, triangles).map(|p| p - origin);
    // With the points' mean as origin, the middle has its own equation: 2 (Σ p pᵀ) c = Σ |p|² p.
    let (mut products, mut right, mut squares) = (Mat3::ZERO, Vec3::ZERO, 0.0);
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
fn roughness(mesh: &MorphMesh, triangles: &[[u32; 3]], ball: &Vec4) -> f32 {
    let off = positions(mesh, triangles).map(|p| (p.distance(ball.truncate()) / ball.w - 1.0).abs());
    off.sum::<f32>() / (3 * triangles.len()).max(1) as f32
}

/// Returns whether the corners lie on the sphere and cover most of it, and the sphere is as large as an eye.
fn is_eyeball(mesh: &MorphMesh, triangles: &[[u32; 3]], ball: &Vec4) -> bool {
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

    #[test]
    fn painted_faces_are_parts_of_their_surfaces() {
        let mesh = head(&HeadDesc::default().vertices(600).targets(1)).to_mesh(Default::default()).expect("a mesh");
        let surface = |double_sided| {
            let (texture, place) = (None, Default::default());
            Arc::new(Surface { colour: [1.0; 4], texture, place, alpha: crate::Alpha::Opaque, double_sided })
        };
        let (one, other) = (surface(false), surface(true));
        let mut surfaces = vec![None; mesh.faces.sizes.len()];
        (surfaces[3], surfaces[5], surfaces[7]) = (Some(one.clone()), Some(other.clone()), Some(one.clone()));
        let (all, found) = (parts(&mesh, &[""; 0]), painted(&mesh, &[""; 0], &surfaces));
        let painted: Vec<&Part> = found.iter().filter(|part| part.material == Material::Painted).collect();
        assert_eq!(painted.iter().map(|part| part.surface.clone()).collect::<Vec<_>>(), [Some(one), Some(other)]);
        let triangles = |parts: &[Part]| parts.iter().map(|part| part.triangles.len()).sum::<usize>();
        assert_eq!(triangles(&all), triangles(&found));
        assert!(painted[0].triangles.len() >= 2 && painted[1].ball.is_none());
    }
}
