//! What the faces of a mesh are called: importers keep neither groups nor materials.

use deltamorph::{Corner, MorphMesh};
use std::path::Path;

/// A name for each face: of a folder, that of the material in its `neutral.obj`, or of the group where no face has a
/// material; of the built-in head, what its part is. None at all where the input is of another kind, or names nothing.
pub fn of_faces(input: Option<&Path>, mesh: &MorphMesh) -> Vec<String> {
    match input {
        Some(folder) => {
            of_obj(&String::from_utf8_lossy(&std::fs::read(folder.join("neutral.obj")).unwrap_or_default()))
        }
        None => of_head(mesh),
    }
}

/// The tiles of its texture coordinates tell the parts of the built-in head apart.
fn of_head(mesh: &MorphMesh) -> Vec<String> {
    const PARTS: [&str; 4] = ["skin", "eye", "teeth", "mouth"];
    let u = |corner: &Corner| corner.texcoord.map_or(0.0, |t| mesh.texcoords[t as usize].x);
    let part = |face: &[Corner]| {
        let middle = face.iter().map(u).sum::<f32>() / face.len() as f32;
        PARTS.get(middle as usize).copied().unwrap_or_default().to_owned()
    };
    mesh.faces.iter().map(part).collect()
}

fn of_obj(text: &str) -> Vec<String> {
    let (mut group, mut material) = (String::new(), String::new());
    let (mut groups, mut materials) = (vec![], vec![]);
    // A line that ends in a backslash goes on; only faces are as long.
    let text = text.replace("\\\r\n", " ").replace("\\\n", " ");
    for line in text.split(['\n', '\r']) {
        let (keyword, rest) = line.trim_start().split_once(char::is_whitespace).unwrap_or((line, ""));
        match keyword {
            "g" | "o" => group = rest.trim().to_owned(),
            "usemtl" => material = rest.trim().to_owned(),
            "f" => {
                groups.push(group.clone());
                materials.push(material.clone());
            }
            _ => {}
        }
    }
    let named = |names: &Vec<String>| names.iter().any(|name| !name.is_empty());
    [materials, groups].into_iter().find(named).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn materials_come_before_groups_and_groups_before_nothing() {
        let faces = "g a\nf 1 2 3\ng b\r\nf 1 2 \\\n 3\n";
        assert_eq!(of_obj(faces), ["a", "b"]);
        assert_eq!(of_obj(&format!("{faces}usemtl m\nf 1 2 3")), ["", "", "m"]);
        assert!(of_obj("f 1 2 3\nf 2 3 4").is_empty());
    }
}
