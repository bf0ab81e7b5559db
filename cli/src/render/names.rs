//! Names of a mesh's faces, since importers keep neither groups nor materials.

use deltamorph::KeptMesh;
use deltamorph::mesh::Corner;
use std::path::Path;

/// A name for each face: in a folder, its material in `neutral.obj`, or its group if no face has a material; in the
/// built-in head, its part. Empty for other kinds of input, or without names.
pub fn of_faces(input: Option<&Path>, mesh: &KeptMesh) -> Vec<String> {
    match input {
        Some(folder) => {
            of_obj(&String::from_utf8_lossy(&std::fs::read(folder.join("neutral.obj")).unwrap_or_default()))
        }
        None => of_head(mesh),
    }
}

/// Parts of the built-in head have separate tiles of texture coordinates.
fn of_head(mesh: &KeptMesh) -> Vec<String> {
    const PARTS: [&str; 4] = ["skin", "eye", "teeth", "mouth"];
    let u = |corner: &Corner| corner.texcoord.map_or(0.0, |t| mesh.texcoords[t as usize].x);
    let part = |face: &[Corner]| {
        let middle = face.iter().map(u).sum::<f32>() / face.len() as f32;
        PARTS.get(middle as usize).copied().unwrap_or_default().to_owned()
    };
    mesh.faces.iter().map(part).collect()
}

fn of_obj(text: &str) -> Vec<String> {
    let mut group = String::new();
    let mut material = String::new();
    let mut groups = vec![];
    let mut materials = vec![];
    // A backslash at the end continues a line; only faces are that long.
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
