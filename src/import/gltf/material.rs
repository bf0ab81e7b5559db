//! Base colours: what of materials is read.

use super::container::Container;
use super::json::At;
use crate::error::Result;
use crate::import::shortened;

/// The base colour of a surface, and how it is drawn.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Material {
    /// Its name, which may be empty.
    pub name: String,
    /// Linear red, green, blue, and opacity; the factor of the texture, if there is one.
    pub base_color: [f32; 4],
    /// Whether a texture, which is not read, has its colours.
    pub is_textured: bool,
    /// Whether opacity is ignored: neither masked nor blended.
    pub is_opaque: bool,
    /// Whether back faces are drawn, too, lit from their own side.
    pub double_sided: bool,
}

/// Reads a material. A value that cannot be used is taken for the default.
pub(super) fn material(file: &Container, at: &At<'_>) -> Result<Material> {
    let mode = at.text_or_empty("alphaMode");
    if !["", "OPAQUE", "MASK", "BLEND"].contains(&mode) {
        file.note(at, format!("alphaMode '{}', taken for OPAQUE", shortened(mode)));
    }
    let metallic = at.get("pbrMetallicRoughness");
    let base_color = metallic.as_ref().map_or(Ok([1.0; 4]), |at| at.numbers("baseColorFactor", [1.0; 4]));
    Ok(Material {
        name: at.text_or_empty("name").to_owned(),
        base_color: file.leave_out(base_color, "colour")?.unwrap_or([1.0; 4]),
        is_textured: metallic.is_some_and(|metallic| metallic.get("baseColorTexture").is_some()),
        is_opaque: !["MASK", "BLEND"].contains(&mode),
        double_sided: at.flag("doubleSided"),
    })
}
