//! Base colours: what of materials is read.

use super::container::Container;
use crate::error::Result;
use std::path::Path;

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

/// Reads the materials of a file, in their order.
///
/// # Errors
/// Those of [`read`](super::read) that concern the file as a whole, or its materials.
pub fn read_materials(path: &Path) -> Result<Vec<Material>> {
    let file = Container::read(path)?;
    let mut found = vec![];
    for at in file.root().items("materials")? {
        let is_opaque = match at.text_or_empty("alphaMode") {
            "" | "OPAQUE" => true,
            "MASK" | "BLEND" => false,
            other => return Err(at.refuse(format!("alphaMode '{other}'"), "use OPAQUE, MASK or BLEND")),
        };
        let metallic = at.get("pbrMetallicRoughness");
        found.push(Material {
            name: at.text_or_empty("name").to_owned(),
            base_color: metallic.as_ref().map_or(Ok([1.0; 4]), |at| at.numbers("baseColorFactor", [1.0; 4]))?,
            is_textured: metallic.is_some_and(|metallic| metallic.get("baseColorTexture").is_some()),
            is_opaque,
            double_sided: at.flag("doubleSided"),
        });
    }
    Ok(found)
}
