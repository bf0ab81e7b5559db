//! What the faces of a mesh are called: importers keep neither groups nor materials.

use std::path::Path;

/// A name for each face of the folder's `neutral.obj`: that of its material, or of its group where no face has a material.
/// None at all where the input is of another kind, or names nothing.
pub fn of_faces(input: Option<&Path>) -> Vec<String> {
    let text = input.and_then(|folder| std::fs::read(folder.join("neutral.obj")).ok()).unwrap_or_default();
    of_obj(&String::from_utf8_lossy(&text))
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
