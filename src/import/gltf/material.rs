//! Base colours: what of materials is read, and their images as the file has them.

use super::container::Container;
use super::json::At;
use crate::error::Result;
use glam::{Affine2, Vec2};
use std::path::Path;

/// The materials of a file, and the images of their base colours.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct Materials {
    /// The materials, in the order of the file.
    pub materials: Vec<Material>,
    /// The bytes of each image of the file, not decoded: usually PNG or JPEG. Empty for images that no base colour uses
    /// or that are not there.
    pub images: Vec<Vec<u8>>,
    /// Remarks for the user.
    pub notes: Vec<String>,
}

/// The base colour of a surface, and how it is drawn.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Material {
    /// Its name, which may be empty.
    pub name: String,
    /// Linear red, green, blue, and opacity; the factor of the texture, if there is one.
    pub base_color: [f32; 4],
    /// The texture: colours in sRGB, and opacity.
    pub texture: Option<Texture>,
    /// The meaning of opacity.
    pub alpha: Alpha,
    /// Whether back faces are drawn, too, lit from their own side.
    pub double_sided: bool,
}

/// A texture of base colours.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Texture {
    /// Index of its image in [`Materials::images`]; `None` if the file has it only in a way that an extension adds.
    pub image: Option<usize>,
    /// The set of texture coordinates.
    pub texcoord: usize,
    /// The transform of texture coordinates (KHR_texture_transform).
    pub transform: Affine2,
    /// What is beyond 0 and 1, across and down.
    pub wrap: [Wrap; 2],
}

/// What a texture shows beyond its edges.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Wrap {
    /// The texture again.
    Repeat,
    /// Its mirror image.
    Mirror,
    /// The texels at the edge.
    Clamp,
}

/// The meaning of opacity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Alpha {
    /// None.
    Opaque,
    /// Only what has at least this opacity is drawn, opaque.
    Mask(f32),
    /// What is behind shows through.
    Blend,
}

/// Reads the materials of a file, and the images that their base colours use.
///
/// # Errors
/// Those of [`read`](super::read) that concern the file as a whole, or its materials. An image that is not there is no
/// error, but a note.
pub fn read_materials(path: &Path) -> Result<Materials> {
    materials(&Container::read(path)?)
}

fn materials(file: &Container) -> Result<Materials> {
    let root = file.root();
    let images = root.items("images")?;
    let mut found = Materials { images: vec![vec![]; images.len()], ..Materials::default() };
    for at in root.items("materials")? {
        let metallic = at.get("pbrMetallicRoughness");
        let alpha = match at.text_or_empty("alphaMode") {
            "" | "OPAQUE" => Alpha::Opaque,
            "MASK" => Alpha::Mask(at.number("alphaCutoff", 0.5)?),
            "BLEND" => Alpha::Blend,
            other => return Err(at.refuse(format!("alphaMode '{other}'"), "use OPAQUE, MASK or BLEND")),
        };
        let stated = metallic.as_ref().and_then(|metallic| metallic.get("baseColorTexture"));
        let texture = stated.map(|stated| texture(&root, &stated)).transpose()?;
        match texture.as_ref().map(|texture| texture.image) {
            Some(Some(number)) => {
                if let Err(why) = image(file, &images, &mut found.images, number) {
                    found.notes.push(format!("{why}; it is left out"));
                }
            }
            Some(None) => {
                let place = &at.place;
                found.notes.push(format!("{place}: its texture is neither PNG nor JPEG, and left out"));
            }
            None => {}
        }
        found.materials.push(Material {
            name: at.text_or_empty("name").to_owned(),
            base_color: match &metallic {
                Some(metallic) => metallic.numbers("baseColorFactor", [1.0; 4])?,
                None => [1.0; 4],
            },
            texture,
            alpha,
            double_sided: at.flag("doubleSided"),
        });
    }
    Ok(found)
}

fn texture(root: &At<'_>, stated: &At<'_>) -> Result<Texture> {
    let texture = root.item("textures", &stated.need("index")?)?;
    let source = texture.get("source");
    source.iter().try_for_each(|source| root.item("images", source).map(drop))?;
    let transform = stated.get("extensions").and_then(|extensions| extensions.get("KHR_texture_transform"));
    let mut made = Texture {
        image: source.map(|source| source.whole()).transpose()?,
        texcoord: stated.whole_or("texCoord", 0)?,
        transform: Affine2::IDENTITY,
        wrap: [Wrap::Repeat; 2],
    };
    if let Some(at) = transform {
        made.texcoord = at.whole_or("texCoord", made.texcoord)?;
        let scale = Vec2::from(at.numbers("scale", [1.0; 2])?);
        let offset = Vec2::from(at.numbers("offset", [0.0; 2])?);
        // Counter-clockwise, where y points down.
        made.transform = Affine2::from_scale_angle_translation(scale, -at.number("rotation", 0.0)?, offset);
    }
    if let Some(sampler) = texture.get("sampler") {
        let sampler = root.item("samplers", &sampler)?;
        for (wrap, key) in made.wrap.iter_mut().zip(["wrapS", "wrapT"]) {
            *wrap = match sampler.whole_or(key, 10497)? {
                33071 => Wrap::Clamp,
                33648 => Wrap::Mirror,
                _ => Wrap::Repeat,
            };
        }
    }
    Ok(made)
}

/// Reads the bytes of an image, unless they are there.
fn image(file: &Container, images: &[At<'_>], read: &mut [Vec<u8>], number: usize) -> Result<()> {
    if read[number].is_empty() {
        let at = &images[number];
        read[number] = match at.get("uri") {
            Some(uri) => file.beside(&uri)?,
            None => file.view(&at.need("bufferView")?)?.bytes.to_vec(),
        };
    }
    Ok(())
}
