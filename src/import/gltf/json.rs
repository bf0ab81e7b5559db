//! Values of the JSON, each with its place, so that errors name it: `a.glb: accessors[3].count: …`.

use crate::error::{Error, Result, ensure};
use crate::import::shortened;
use serde_json::Value;
use std::fmt::Display;
use std::path::Path;

/// Memory that parsing may take, estimated in advance: hostile text is mostly brackets and commas.
const MEMORY_MAX: usize = 1 << 30;
const OBJECT_BYTES: usize = 700;
const ELEMENT_BYTES: usize = 80;

/// Parses the JSON of a file.
pub fn parse(path: &Path, text: &[u8]) -> Result<Value> {
    let count = |byte: u8| text.iter().filter(|b| **b == byte).count();
    let memory = (count(b'{') * OBJECT_BYTES).saturating_add((count(b',') + count(b'[')) * ELEMENT_BYTES);
    let what = format!("its JSON has so many values that they would take {} MiB", memory >> 20);
    ensure!(memory <= MEMORY_MAX, Error::input(path, "", what, "split the file, or keep arrays in buffers"));
    serde_json::from_slice(text).map_err(|e| {
        let place = format!(": line {} column {} of its JSON", e.line(), e.column());
        Error::input(path, place, e.to_string(), "export the file again: its JSON is damaged")
    })
}

/// A value and its place.
#[derive(Clone, Debug)]
pub struct At<'a> {
    pub path: &'a Path,
    pub value: &'a Value,
    /// The place, such as `meshes[0].primitives[1]`; empty for the root.
    pub place: String,
}

impl<'a> At<'a> {
    /// Makes an error about this value.
    pub fn refuse(&self, what: impl Display, remedy: &str) -> Error {
        let place = if self.place.is_empty() { String::new() } else { format!(": {}", self.place) };
        Error::input(self.path, place, what.to_string(), remedy)
    }

    /// The property `key`, if there is one. One that is null has no value: serialisers write it for what is absent.
    pub fn get(&self, key: &str) -> Option<Self> {
        let dot = if self.place.is_empty() { "" } else { "." };
        let place = |value| At { path: self.path, value, place: format!("{}{dot}{key}", self.place) };
        self.value.get(key).filter(|value| !value.is_null()).map(place)
    }

    /// The extension `name`, if it is there.
    pub fn extension(&self, name: &str) -> Option<Self> {
        self.get("extensions")?.get(name)
    }

    /// The property `key`; an error if there is none.
    pub fn need(&self, key: &str) -> Result<Self> {
        self.get(key).ok_or_else(|| self.refuse(format!("no property '{key}'"), REPAIR))
    }

    /// The elements of the array `key`; none if there is no such property.
    pub fn items(&self, key: &str) -> Result<Vec<Self>> {
        self.get(key).map_or(Ok(vec![]), |list| list.elements())
    }

    /// The elements of this array. Their places have their names, too.
    pub fn elements(&self) -> Result<Vec<Self>> {
        let values = self.value.as_array().ok_or_else(|| self.refuse("no array", REPAIR))?;
        let element = |(i, value): (usize, &'a Value)| {
            let name = value["name"].as_str().filter(|name| !name.is_empty());
            let name = name.map_or(String::new(), |name| format!(" '{}'", shortened(name)));
            At { path: self.path, value, place: format!("{}[{i}]{name}", self.place) }
        };
        Ok(values.iter().enumerate().map(element).collect())
    }

    /// The element of the array `key` of this value that `index` names. Its place begins with the one that names it.
    pub fn item(&self, key: &str, index: &At<'_>) -> Result<Self> {
        let i = self.index_of(key, index)?;
        Ok(At { path: self.path, value: &self.value[key][i], place: format!("{}: {key}[{i}]", index.place) })
    }

    /// The number `index`, if the array `key` of this value has such an element.
    pub fn index_of(&self, key: &str, index: &At<'_>) -> Result<usize> {
        let i = index.whole()?;
        let count = self.value[key].as_array().map_or(0, Vec::len);
        let what = || format!("{i}, but there are {count} {key}, counted from 0");
        ensure!(i < count, index.refuse(what(), "export the file again: it names what it does not have"));
        Ok(i)
    }

    /// A whole number, 0 or more.
    pub fn whole(&self) -> Result<usize> {
        // Exporters write 3.0 as well.
        let float = || self.value.as_f64().filter(|x| x.fract() == 0.0 && (0.0..9e15).contains(x)).map(|x| x as u64);
        let number = self.value.as_u64().or_else(float).and_then(|n| usize::try_from(n).ok());
        number.ok_or_else(|| self.refuse(format!("{} is no whole number, 0 or more", self.short()), REPAIR))
    }

    /// The property `key` as a whole number; `default` if there is none.
    pub fn whole_or(&self, key: &str, default: usize) -> Result<usize> {
        self.get(key).map_or(Ok(default), |value| value.whole())
    }

    /// The property `key` as an index, if there is one.
    pub fn index(&self, key: &str) -> Result<Option<usize>> {
        self.get(key).map(|value| value.whole()).transpose()
    }

    /// The `N` finite numbers of the property `key`; `default` if there is none.
    pub fn numbers<const N: usize>(&self, key: &str, default: [f32; N]) -> Result<[f32; N]> {
        let Some(list) = self.get(key) else { return Ok(default) };
        let numbers = list.floats()?;
        let count = numbers.len();
        numbers.try_into().map_err(|_| list.refuse(format!("{count} numbers, {N} expected"), REPAIR))
    }

    /// Whether the property `key` is `true`.
    pub fn flag(&self, key: &str) -> bool {
        self.value[key].as_bool().unwrap_or_default()
    }

    fn float(&self) -> Result<f32> {
        let found = self.value.as_f64().map(|x| x as f32).filter(|x| x.is_finite());
        found.ok_or_else(|| self.refuse(format!("{} is no number that single precision holds", self.short()), REPAIR))
    }

    /// An array of finite numbers.
    pub fn floats(&self) -> Result<Vec<f32>> {
        self.elements()?.iter().map(At::float).collect()
    }

    /// The finite numbers of the array `key`; none if there is no such property.
    pub fn floats_or_none(&self, key: &str) -> Result<Vec<f32>> {
        self.get(key).map_or(Ok(vec![]), |list| list.floats())
    }

    /// Text.
    pub fn text(&self) -> Result<&'a str> {
        self.value.as_str().ok_or_else(|| self.refuse(format!("{} is no text", self.short()), REPAIR))
    }

    /// The property `key` as text; empty if there is none.
    pub fn text_or_empty(&self, key: &str) -> &'a str {
        self.value[key].as_str().unwrap_or_default()
    }

    fn short(&self) -> String {
        let text = match self.value {
            Value::Array(_) => "an array".to_owned(),
            Value::Object(_) => "an object".to_owned(),
            Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => self.value.to_string(),
        };
        shortened(&text)
    }
}

const REPAIR: &str = "export the file again, or repair this value";
