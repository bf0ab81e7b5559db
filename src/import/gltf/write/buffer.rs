//! Accessors, buffer views and the bytes of a GLB file.

use super::{GlbEncoding, encode};
use crate::error::{Error, Result};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// How numbers are stored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Component {
    F32,
    I8,
    I16,
    U16,
    U32,
    /// Normalised: fractions of the largest one.
    Unit8,
    Unit16,
    UnitU16,
}

impl Component {
    /// The smallest one for whole numbers up to `largest`, either sign; floats if there is none.
    pub fn signed(largest: f32) -> Self {
        match largest {
            0.0..=127.0 => Self::I8,
            0.0..=32767.0 => Self::I16,
            _ => Self::F32,
        }
    }

    /// glTF's number, the size in bytes, and the largest integer where that stands for 1.
    fn properties(self) -> (u32, usize, Option<f64>) {
        match self {
            Self::I8 => (5120, 1, None),
            Self::I16 => (5122, 2, None),
            Self::U16 => (5123, 2, None),
            Self::U32 => (5125, 4, None),
            Self::F32 => (5126, 4, None),
            Self::Unit8 => (5120, 1, Some(127.0)),
            Self::Unit16 => (5122, 2, Some(32767.0)),
            Self::UnitU16 => (5123, 2, Some(65535.0)),
        }
    }

    /// What a reader gets for `value`.
    pub fn rounded(self, value: f64) -> f64 {
        self.properties().2.map_or(value, |one| (value * one).round() / one)
    }

    fn write(self, value: f32, out: &mut Vec<u8>) {
        let (_, size, one) = self.properties();
        if self == Self::F32 {
            return out.extend(value.to_le_bytes());
        }
        let whole = (f64::from(value) * one.unwrap_or(1.0)).round() as i64;
        out.extend(&whole.to_le_bytes()[..size]);
    }
}

/// Elements of `width` numbers each.
#[derive(Clone, Debug)]
pub struct Elements<'a> {
    values: &'a [f32],
    width: usize,
    component: Component,
    /// Whether the accessor states the least and the largest of each component, as those of positions have to.
    bounded: bool,
}

impl<'a> Elements<'a> {
    pub fn of(values: &'a [f32], width: usize, component: Component) -> Self {
        Self { values, width, component, bounded: false }
    }

    pub fn bounded(self) -> Self {
        Self { bounded: true, ..self }
    }

    fn count(&self) -> usize {
        self.values.len() / self.width
    }

    fn size(&self) -> usize {
        self.width * self.component.properties().1
    }

    /// The bytes of elements, every `stride` bytes. `places`: where they stand among how many; the others are zero.
    fn bytes(&self, stride: usize, places: Option<(&[u32], usize)>) -> Vec<u8> {
        let mut out = vec![];
        for (i, element) in self.values.chunks_exact(self.width).enumerate() {
            out.resize(places.map_or(i, |(places, _)| places[i] as usize) * stride, 0);
            element.iter().for_each(|value| self.component.write(*value, &mut out));
        }
        out.resize(places.map_or(self.count(), |(_, count)| count) * stride, 0);
        out
    }

    /// An accessor of `count` elements, still without bytes: those that are not there are zero.
    fn accessor(&self, count: usize) -> Value {
        let (number, _, one) = self.component.properties();
        let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][self.width - 1];
        let mut accessor = json!({"componentType": number, "count": count, "type": kind});
        if one.is_some() {
            accessor["normalized"] = json!(true);
        }
        if self.bounded {
            let others = (self.count() < count).then_some(0.0);
            let bound = |of: fn(f32, f32) -> f32| -> Vec<Value> {
                let column = |c: usize| self.values.iter().skip(c).step_by(self.width).copied().chain(others);
                let bounds = (0..self.width).map(|c| column(c).reduce(of).unwrap_or_default());
                bounds.map(|x| if number == 5126 { json!(x) } else { json!(x as i64) }).collect()
            };
            (accessor["min"], accessor["max"]) = (json!(bound(f32::min)), json!(bound(f32::max)));
        }
        accessor
    }
}

/// What a buffer view is for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Use {
    Attribute,
    Triangles,
    /// Indices or values of sparse accessors, which state no target and no stride.
    SparseIndices,
    SparseValues,
}

/// The bytes of a file, and what lists them.
#[derive(Debug)]
pub struct Buffer {
    encoding: GlbEncoding,
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    /// Bytes that compressed views have when they are decompressed.
    decompressed: usize,
    /// The last list of sparse indices, and its view: positions and normals share them.
    listed: (Vec<u32>, usize),
    /// Elements of dense accessors of targets by their stride, and the view that will have them: one is enough for all.
    pooled: BTreeMap<usize, (Vec<u8>, usize)>,
}

impl Buffer {
    pub fn new(encoding: GlbEncoding) -> Self {
        Self {
            encoding,
            bytes: vec![],
            views: vec![],
            accessors: vec![],
            decompressed: 0,
            listed: (vec![], 0),
            pooled: BTreeMap::new(),
        }
    }

    fn push(&mut self, accessor: Value) -> Value {
        self.accessors.push(accessor);
        json!(self.accessors.len() - 1)
    }

    /// Adds bytes; returns where they begin. Each part begins at a multiple of four.
    fn append(&mut self, bytes: &[u8]) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.bytes.extend(bytes);
        self.bytes.len() - bytes.len()
    }

    /// Compressed bytes of elements of `size` bytes, and the mode; `None` where it is not compressed.
    fn compressed(&self, bytes: &[u8], size: usize, of: Use) -> Option<(Vec<u8>, &'static str)> {
        let indices = || match size {
            2 => bytes.as_chunks().0.iter().map(|b| u16::from_le_bytes(*b).into()).collect::<Vec<u32>>(),
            _ => bytes.as_chunks().0.iter().map(|b| u32::from_le_bytes(*b)).collect(),
        };
        let found = match of {
            Use::Triangles => (encode::triangles(&indices()), "TRIANGLES"),
            Use::SparseIndices => (encode::indices(&indices()), "INDICES"),
            Use::Attribute | Use::SparseValues if size.is_multiple_of(4) => {
                (encode::attributes(bytes, size), "ATTRIBUTES")
            }
            Use::Attribute | Use::SparseValues => return None,
        };
        Some(found).filter(|(data, _)| self.encoding == GlbEncoding::Meshopt && data.len() < bytes.len())
    }

    /// Adds a view of elements of `size` bytes.
    fn view(&mut self, bytes: &[u8], size: usize, of: Use) -> usize {
        let mut view = match self.compressed(bytes, size, of) {
            None => {
                let at = self.append(bytes);
                json!({"buffer": 0, "byteOffset": at, "byteLength": bytes.len()})
            }
            Some((data, mode)) => {
                let at = self.append(&data);
                let extension = json!({
                    "buffer": 0, "byteOffset": at, "byteLength": data.len(),
                    "byteStride": size, "count": bytes.len() / size, "mode": mode,
                });
                let at = self.decompressed;
                self.decompressed += bytes.len().next_multiple_of(4);
                json!({
                    "buffer": 1, "byteOffset": at, "byteLength": bytes.len(),
                    "extensions": {"EXT_meshopt_compression": extension},
                })
            }
        };
        match of {
            Use::Attribute => {
                view["target"] = json!(34962);
                view["byteStride"] = json!(size);
            }
            Use::Triangles => view["target"] = json!(34963),
            Use::SparseIndices | Use::SparseValues => {}
        }
        self.views.push(view);
        self.views.len() - 1
    }

    /// Adds an accessor of all elements.
    pub fn dense(&mut self, elements: &Elements<'_>, of: Use) -> Value {
        let stride = elements.size().next_multiple_of(4);
        let mut accessor = elements.accessor(elements.count());
        accessor["bufferView"] = json!(self.view(&elements.bytes(stride, None), stride, of));
        self.push(accessor)
    }

    /// Adds an accessor of `count` elements, of which those at `places` are not zero: sparse, or with zeros between
    /// them, whichever takes less.
    pub fn sparse(&mut self, elements: &Elements<'_>, places: &[u32], count: usize) -> Value {
        // An accessor without bytes is all zero, but the crate `gltf`, and so Bevy, refuses files that have one.
        if places.is_empty() {
            return self.sparse(&Elements { values: &[0.0; 4][..elements.width], ..elements.clone() }, &[0], count);
        }
        let mut accessor = elements.accessor(count);
        let stride = elements.size().next_multiple_of(4);
        let dense = elements.bytes(stride, Some((places, count)));
        let values = elements.bytes(elements.size(), None);
        let narrow = count <= 1 << 16;
        let width = if narrow { 2 } else { 4 };
        let indices: Vec<u8> = places.iter().flat_map(|v| v.to_le_bytes().into_iter().take(width)).collect();
        let is_listed = self.listed.0 == places;
        let taken =
            |bytes: &[u8], size, of| self.compressed(bytes, size, of).map_or(bytes.len(), |(data, _)| data.len());
        let listing = if is_listed { 0 } else { taken(&indices, width, Use::SparseIndices) };
        if listing + taken(&values, elements.size(), Use::SparseValues) < taken(&dense, stride, Use::Attribute) {
            if !is_listed {
                self.listed = (places.to_vec(), self.view(&indices, width, Use::SparseIndices));
            }
            let component = if narrow { Component::U16 } else { Component::U32 };
            let values = self.view(&values, elements.size(), Use::SparseValues);
            accessor["sparse"] = json!({
                "count": places.len(), "values": {"bufferView": values},
                "indices": {"bufferView": self.listed.1, "componentType": component.properties().0},
            });
        } else {
            let Self { pooled, views, .. } = self;
            let (pool, view) = pooled.entry(stride).or_insert_with(|| {
                views.push(Value::Null);
                (vec![], views.len() - 1)
            });
            (accessor["bufferView"], accessor["byteOffset"]) = (json!(view), json!(pool.len()));
            pool.extend(dense);
        }
        self.push(accessor)
    }

    /// Adds the index buffer of triangles over `vertices` vertices. The largest number of 16 bits is no vertex.
    pub fn indices(&mut self, indices: &[u32], vertices: usize) -> Value {
        let component = if vertices < 1 << 16 { Component::U16 } else { Component::U32 };
        let (number, width, _) = component.properties();
        let bytes: Vec<u8> = indices.iter().flat_map(|v| v.to_le_bytes().into_iter().take(width)).collect();
        let view = self.view(&bytes, width, Use::Triangles);
        self.push(json!({"bufferView": view, "componentType": number, "count": indices.len(), "type": "SCALAR"}))
    }

    /// Puts the file together; `json` is what refers to accessors.
    pub fn glb(mut self, mut json: Value) -> Result<Vec<u8>> {
        let padded = |mut bytes: Vec<u8>, with: u8| {
            bytes.resize(bytes.len().next_multiple_of(4), with);
            bytes
        };
        for (stride, (pool, view)) in std::mem::take(&mut self.pooled) {
            let at = self.view(&pool, stride, Use::Attribute);
            self.views.swap(view, at);
            self.views.truncate(at);
        }
        let bytes = padded(std::mem::take(&mut self.bytes), 0);
        let mut buffers = vec![json!({"byteLength": bytes.len()})];
        let mut extensions = vec![];
        if self.encoding != GlbEncoding::Float {
            extensions.push("KHR_mesh_quantization");
        }
        if self.decompressed > 0 {
            extensions.push("EXT_meshopt_compression");
            let fallback = json!({"EXT_meshopt_compression": {"fallback": true}});
            buffers.push(json!({"byteLength": self.decompressed, "extensions": fallback}));
        }
        if !extensions.is_empty() {
            (json["extensionsUsed"], json["extensionsRequired"]) = (json!(extensions), json!(extensions));
        }
        json["asset"] = json!({"version": "2.0", "generator": concat!("deltamorph ", env!("CARGO_PKG_VERSION"))});
        (json["accessors"], json["bufferViews"], json["buffers"]) =
            (json!(self.accessors), json!(self.views), json!(buffers));
        let text = padded(json.to_string().into_bytes(), b' ');
        let length = 12 + 8 + text.len() + 8 + bytes.len();
        let length = u32::try_from(length).map_err(|_| {
            Error::invalid(format!("{length} bytes, more than a GLB file can have"), "split the mesh, or quantise it")
        })?;
        let mut file = Vec::with_capacity(length as usize);
        file.extend(b"glTF");
        [2, length].iter().for_each(|word| file.extend(word.to_le_bytes()));
        for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &bytes)] {
            file.extend((chunk.len() as u32).to_le_bytes());
            file.extend(kind);
            file.extend(chunk);
        }
        Ok(file)
    }
}
