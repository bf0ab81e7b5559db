//! Rigs from JSON files.

use super::{Control, Corrective, Key, Part, Rig};
use deltamorph::internals::{TEXT_MAX, read_bounded};
use deltamorph::{Error, Result};
use serde::Deserialize;
use std::path::Path;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    controls: Vec<ControlText>,
    #[serde(default)]
    correctives: Vec<Product>,
    #[serde(default)]
    keep_targets: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ControlText {
    name: String,
    limits: Option<[f32; 2]>,
    #[serde(default)]
    smoothing: f32,
    keys: Option<Vec<KeyText>>,
    sequence: Option<Vec<String>>,
    #[serde(default)]
    parts: Vec<PartText>,
    #[serde(default)]
    binary: bool,
    #[serde(default)]
    blocks: Vec<String>,
    #[serde(default)]
    attenuates: Vec<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PartText {
    target: String,
    weight: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct KeyText {
    at: f32,
    target: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Product {
    target: String,
    controls: Vec<String>,
}

/// Reads a rig from a JSON file.
///
/// ```json
/// {
///   "controls": [
///     {"name": "eyeBlinkLeft", "limits": [0, 1], "smoothing": 0.05, "keys": [
///       {"at": 0.5, "target": "eyeBlinkLeft_half"}, {"at": 1, "target": "eyeBlinkLeft"}]},
///     {"name": "turn", "sequence": ["turn_1", "turn_2", "turn_3"]},
///     {"name": "jawOpen", "limits": [0, 1]},
///     {"name": "happy", "limits": [0, 1], "binary": true, "attenuates": ["eyeBlinkLeft"], "blocks": ["jawOpen"],
///      "parts": [{"target": "smile", "weight": 1}, {"target": "cheeks", "weight": 0.5}]}
///   ],
///   "correctives": [{"target": "jawOpen_smile", "controls": ["jawOpen", "mouthSmile"]}],
///   "keep_targets": false
/// }
/// ```
///
/// All properties but names and targets are optional. [`Rig`] explains them. `"sequence"` is [`Control::sequence`].
///
/// Takes at most 300 bytes of memory per byte of the file, and 1 MiB, regardless of the counts in it.
///
/// # Errors
/// [`Error::Io`] for a file that cannot be read; [`Error::Input`] for JSON of another form, including unknown
/// properties, which are probably misspelt. [`Rig::bind`] checks that names are those of targets.
pub fn read(path: &Path) -> Result<Rig> {
    let text = read_bounded(path, TEXT_MAX, "a rig is a few kilobytes of JSON: give that file")?;
    parse(path, &text)
}

fn parse(path: &Path, text: &[u8]) -> Result<Rig> {
    let file: File = serde_json::from_slice(text).map_err(|e| {
        let (text, place) = (e.to_string(), format!(" at line {} column {}", e.line(), e.column()));
        let what = text.strip_suffix(&place).unwrap_or(&text);
        Error::input(
            path,
            format!(": line {}", e.line()),
            what,
            "see the documentation of rig::read for the properties of a rig",
        )
    })?;
    let controls = file.controls.into_iter().map(|control| control.read(path)).collect::<Result<_>>()?;
    let correctives = file.correctives.into_iter().map(|p| Corrective { target: p.target, controls: p.controls });
    Ok(Rig { controls, correctives: correctives.collect(), keep_targets: file.keep_targets })
}

impl ControlText {
    fn read(self, path: &Path) -> Result<Control> {
        let Self { name, limits, smoothing, keys, sequence, parts, binary, blocks, attenuates } = self;
        let parts = parts.into_iter().map(|part| Part::new(part.target, part.weight)).collect();
        let control = Control::new(name).smoothing(smoothing).parts(parts).is_binary(binary);
        let control = control.blocks(blocks).attenuates(attenuates);
        let control = match limits {
            Some(limits) => control.limits(limits),
            None => control,
        };
        Ok(match (keys, sequence) {
            (None, None) => control,
            (Some(keys), None) => control.keys(keys.into_iter().map(|key| Key::new(key.at, key.target)).collect()),
            (None, Some(targets)) => control.sequence(&targets.iter().map(String::as_str).collect::<Vec<_>>()),
            (Some(_), Some(_)) => {
                let place = format!(": control '{}'", control.name);
                return Err(Error::input(path, place, "both keys and a sequence", "leave one of them out"));
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<Rig> {
        parse(Path::new("rig.json"), text.as_bytes())
    }

    #[test]
    fn all_that_a_file_may_state_is_read() {
        let rig = parsed(
            r#"{"controls": [
                {"name": "blink", "limits": [0, 1], "smoothing": 0.05,
                 "keys": [{"at": 0.5, "target": "half"}, {"at": 1, "target": "full"}]},
                {"name": "turn", "sequence": ["a", "b"]}, {"name": "jaw"},
                {"name": "happy", "parts": [{"target": "up", "weight": 0.5}], "binary": true, "blocks": ["jaw"],
                 "attenuates": ["blink"]}],
               "keep_targets": true, "correctives": [{"target": "c", "controls": ["blink", "jaw"]}]}"#,
        );
        let blink = Control::new("blink").limits([0.0, 1.0]).smoothing(0.05);
        let controls = vec![
            blink.keys(vec![Key::new(0.5, "half"), Key::new(1.0, "full")]),
            Control::new("turn").keys(vec![Key::new(0.5, "a"), Key::new(1.0, "b")]),
            Control::new("jaw"),
            Control::new("happy")
                .parts(vec![Part::new("up", 0.5)])
                .is_binary(true)
                .blocks(vec!["jaw".into()])
                .attenuates(vec!["blink".into()]),
        ];
        let correctives = vec![Corrective::new("c", &["blink", "jaw"])];
        assert_eq!(rig.unwrap(), Rig { controls, correctives, keep_targets: true });
        assert_eq!(parsed("{}").unwrap(), Rig::default());
    }

    #[test]
    fn what_is_no_rig_is_refused_with_its_line() {
        for (text, words) in [
            ("{\n\"controls\": 3}", "rig.json: line 2: invalid type: integer `3`, expected a sequence; see the doc"),
            (
                "{\"control\": []}",
                "rig.json: line 1: unknown field `control`, expected one of `controls`, `correctives`, `keep_targets`; see",
            ),
            ("{\"controls\": [{}]}", "missing field `name`"),
            ("{\"controls\": [{\"name\": \"a\", \"keys\": [{\"at\": 1}]}]}", "missing field `target`"),
            (
                "{\"controls\": [{\"name\": \"a\", \"keys\": [], \"sequence\": []}]}",
                ": control 'a': both keys and a sequence",
            ),
            ("[", "rig.json: line 1: EOF while parsing"),
            ("", "rig.json: line 1: EOF"),
        ] {
            deltamorph::testing::says(parsed(text), &[words]);
        }
        let none = read(Path::new("none/rig.json")).unwrap_err().to_string();
        assert!(none.contains("none/rig.json: cannot read"), "{none}");
    }
}
