//! A glTF file that is written piece by piece.

use serde_json::{Value, json};

// Component types.
pub const I8: u32 = 5120;
pub const U8: u32 = 5121;
pub const I16: u32 = 5122;
pub const U16: u32 = 5123;
pub const F32: u32 = 5126;

/// JSON, and the bytes of its one buffer.
#[derive(Clone, Debug)]
pub struct Written {
    pub json: Value,
    pub bytes: Vec<u8>,
}

impl Default for Written {
    fn default() -> Self {
        let json =
            json!({"asset": {"version": "2.0"}, "buffers": [{"byteLength": 0}], "bufferViews": [], "accessors": []});
        Self { json, bytes: vec![] }
    }
}

/// The bytes of integers, as files have them.
pub fn bytes<T: bytemuck::NoUninit>(values: &[T]) -> Vec<u8> {
    bytemuck::cast_slice(values).to_vec()
}

impl Written {
    fn push(&mut self, list: &str, value: Value) -> usize {
        let list = self.json[list].as_array_mut().unwrap();
        list.push(value);
        list.len() - 1
    }

    /// A buffer view of `bytes`.
    pub fn view(&mut self, bytes: &[u8]) -> usize {
        let offset = self.bytes.len();
        self.bytes.extend(bytes);
        self.json["buffers"][0]["byteLength"] = json!(self.bytes.len());
        self.push("bufferViews", json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes.len()}))
    }

    pub fn accessor(&mut self, component: u32, kind: &str, count: usize, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        self.push("accessors", json!({"componentType": component, "type": kind, "count": count, "bufferView": view}))
    }

    pub fn floats<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let kind = match N {
            1 => "SCALAR",
            2 => "VEC2",
            3 => "VEC3",
            4 => "VEC4",
            _ => "MAT4",
        };
        self.accessor(F32, kind, values.len(), &bytes(values.as_flattened()))
    }

    /// As GLB.
    pub fn glb(&self) -> Vec<u8> {
        let padded = |mut bytes: Vec<u8>, with: u8| {
            bytes.resize(bytes.len().next_multiple_of(4), with);
            bytes
        };
        let (json, binary) = (padded(self.json.to_string().into_bytes(), b' '), padded(self.bytes.clone(), 0));
        let words = |words: [usize; 2]| words.map(|word| (word as u32).to_le_bytes()).concat();
        let chunk = |bytes: &[u8], kind: &[u8]| [&(bytes.len() as u32).to_le_bytes(), kind, bytes].concat();
        let length = 12 + 8 + json.len() + 8 + binary.len();
        [b"glTF".to_vec(), words([2, length]), chunk(&json, b"JSON"), chunk(&binary, b"BIN\0")].concat()
    }

    /// As JSON alone, with its buffer in a data URI.
    pub fn gltf(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"][0]["uri"] = json!(format!("data:application/octet-stream;base64,{}", base64(&self.bytes)));
        json.to_string().into_bytes()
    }
}

pub fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for three in bytes.chunks(3) {
        let bits = three.iter().enumerate().fold(0u32, |bits, (i, b)| bits | u32::from(*b) << (16 - 8 * i));
        let letter =
            |i: usize| if i <= three.len() { LETTERS[(bits >> (18 - 6 * i)) as usize & 63] as char } else { '=' };
        text.extend((0..4).map(letter));
    }
    text
}
