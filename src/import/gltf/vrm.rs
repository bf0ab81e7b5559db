//! Expressions of VRM 0 (`VRM`) and VRM 1 (`VRMC_vrm`).

use super::container::Container;
use super::json::At;
use super::mesh::{Mesh, unique};
use super::scene::Node;
use crate::error::Result;
use std::collections::HashMap;

/// An expression of a VRM file: several targets that one value from 0 to 1 drives.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Expression {
    /// Its name, unique in the file: in VRM 0 as the file has it, in VRM 1 that of the preset or its own.
    pub name: String,
    /// What programs drive by themselves; `None` for feelings and expressions of the author's.
    pub kind: Option<Procedural>,
    /// Values above 0.5 count as 1, all others as 0.
    pub is_binary: bool,
    /// Names of targets, and their weights at value 1.
    pub targets: Vec<(String, f32)>,
    /// What it suppresses while it is above 0 (VRM 1).
    pub overrides: Vec<(Procedural, Suppression)>,
}

/// Expressions that programs drive by themselves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Procedural {
    /// Of the lids.
    Blink,
    /// Of the gaze.
    Look,
    /// Of speech.
    Mouth,
}

/// How an expression suppresses others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Suppression {
    /// They count as 0.
    Block,
    /// They are multiplied by 1 less its value.
    Blend,
}

impl Procedural {
    fn of(preset: &str) -> Option<Self> {
        match preset.to_ascii_lowercase().as_str() {
            "blink" | "blinkleft" | "blinkright" | "blink_l" | "blink_r" => Some(Self::Blink),
            "lookup" | "lookdown" | "lookleft" | "lookright" => Some(Self::Look),
            "aa" | "ih" | "ou" | "ee" | "oh" | "a" | "i" | "u" | "e" | "o" => Some(Self::Mouth),
            _ => None,
        }
    }
}

/// Reads the expressions of a file. Remarks are added to `notes`.
pub fn expressions(
    file: &Container,
    meshes: &[Mesh],
    nodes: &[Node],
    notes: &mut Vec<String>,
) -> Result<Vec<Expression>> {
    let Some(extensions) = file.root().get("extensions") else { return Ok(vec![]) };
    let mut found = Found { file, meshes, all: vec![], names: HashMap::new(), lost: 0, with_materials: vec![] };
    if let Some(all) = extensions.get("VRMC_vrm").and_then(|vrm| vrm.get("expressions")) {
        for list in ["preset", "custom"].into_iter().filter_map(|list| all.get(list)) {
            for (name, at) in list.properties() {
                let kind = Procedural::of(name).filter(|_| list.place.ends_with("preset"));
                let mut targets = vec![];
                for bind in at.items("morphTargetBinds")? {
                    let mesh = bind.index("node").ok().flatten().and_then(|node| nodes.get(node)?.mesh);
                    targets.extend(found.bind(&bind, mesh, 1.0)?);
                }
                let overrides = [
                    ("overrideBlink", Procedural::Blink),
                    ("overrideLookAt", Procedural::Look),
                    ("overrideMouth", Procedural::Mouth),
                ];
                let overrides = overrides.into_iter().filter_map(|(key, of)| match at.text_or_empty(key) {
                    // An expression does not override those of its own kind.
                    _ if kind == Some(of) => None,
                    "block" => Some((of, Suppression::Block)),
                    "blend" => Some((of, Suppression::Blend)),
                    _ => None,
                });
                let materials = ["materialColorBinds", "textureTransformBinds"];
                found.add(&at, name, kind, targets, overrides.collect(), materials)?;
            }
        }
    } else if let Some(master) = extensions.get("VRM").and_then(|vrm| vrm.get("blendShapeMaster")) {
        for at in master.items("blendShapeGroups")? {
            let preset = at.text_or_empty("presetName");
            let stated = at.text_or_empty("name");
            let mut targets = vec![];
            for bind in at.items("binds")? {
                let mesh = bind.index("mesh").ok().flatten();
                targets.extend(found.bind(&bind, mesh, 100.0)?);
            }
            let name = if stated.is_empty() { preset } else { stated };
            found.add(&at, name, Procedural::of(preset), targets, vec![], ["materialValues", ""])?;
        }
    }
    let Found { all, lost, with_materials, .. } = found;
    if lost > 0 {
        notes.push(format!("expressions: {lost} binds to targets that there are not are left out"));
    }
    if !with_materials.is_empty() {
        let names = with_materials.join("', '");
        notes.push(format!("expressions move targets alone; what these change in materials is left out: '{names}'"));
    }
    Ok(all)
}

struct Found<'a> {
    file: &'a Container,
    meshes: &'a [Mesh],
    all: Vec<Expression>,
    names: HashMap<String, usize>,
    /// Binds that name no target.
    lost: usize,
    /// Names of those that change materials.
    with_materials: Vec<String>,
}

impl Found<'_> {
    /// The target of a bind and its weight, of which `whole` is 1.
    fn bind(&mut self, bind: &At<'_>, mesh: Option<usize>, whole: f32) -> Result<Option<(String, f32)>> {
        let target = bind.index("index").ok().flatten();
        let target = mesh.zip(target).and_then(|(mesh, i)| self.meshes.get(mesh)?.source.targets.get(i));
        let weight = bind.get("weight").map_or(Some(1.0), |at| at.value.as_f64().map(|x| x as f32 / whole));
        let Some((target, weight)) = target.zip(weight).filter(|(_, weight)| weight.is_finite()) else {
            self.lost += 1;
            return Ok(None);
        };
        self.file.charge(bind, target.name.len(), 1)?;
        Ok(Some((target.name.clone(), weight)))
    }

    fn add(
        &mut self,
        at: &At<'_>,
        name: &str,
        kind: Option<Procedural>,
        targets: Vec<(String, f32)>,
        overrides: Vec<(Procedural, Suppression)>,
        materials: [&str; 2],
    ) -> Result<()> {
        let name = if name.is_empty() { format!("expression {}", self.all.len()) } else { name.to_owned() };
        let name = unique(name, &mut self.names);
        if materials
            .iter()
            .any(|key| at.get(key).is_some_and(|list| list.value.as_array().is_some_and(|l| !l.is_empty())))
            && self.with_materials.len() < 100
        {
            self.with_materials.push(name.chars().take(40).collect());
        }
        // Targets of one name are one target.
        let mut merged: Vec<(String, f32)> = vec![];
        let mut places: HashMap<String, usize> = HashMap::new();
        for (target, weight) in targets {
            let place = *places.entry(target.clone()).or_insert(merged.len());
            match merged.get_mut(place) {
                Some((_, most)) => *most = most.max(weight),
                None => merged.push((target, weight)),
            }
        }
        let is_binary = at.value.get("isBinary").and_then(serde_json::Value::as_bool).unwrap_or(false);
        self.all.push(Expression { name, kind, is_binary, targets: merged, overrides });
        Ok(())
    }
}
