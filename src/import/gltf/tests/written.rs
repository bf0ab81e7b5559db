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

    /// Sets the value at a JSON pointer, which may be new in its object.
    pub fn set(&mut self, at: &str, value: Value) {
        let (parent, key) = at.rsplit_once('/').unwrap();
        match self.json.pointer_mut(parent).unwrap() {
            Value::Array(list) => list[key.parse::<usize>().unwrap()] = value,
            object => object[key] = value,
        }
    }

    /// As GLB.
    pub fn glb(&self) -> Vec<u8> {
        self.stored(0)
    }

    /// Whole files: GLB whose chunks are padded by spaces or zeros or not at all, with lengths that count that or not
    /// (0 to 4), and JSON with its buffer in base64, with or without its last signs, or in lines (5 to 7).
    pub fn stored(&self, way: usize) -> Vec<u8> {
        let mut json = self.json.clone();
        if way > 4 {
            let text = base64(&self.bytes);
            let text = match way {
                5 => text,
                6 => text.trim_end_matches('=').to_owned(),
                _ => text.as_bytes().chunks(11).map(|line| format!("{}\r\n", line.escape_ascii())).collect(),
            };
            json["buffers"][0]["uri"] = json!(format!("data:application/octet-stream;base64,{text}"));
            return json.to_string().into_bytes();
        }
        let json = json.to_string().into_bytes();
        let [space, end] = [&json, &self.bytes].map(|part| part.len().next_multiple_of(4) - part.len());
        // Bytes after the JSON, those that its length counts, and bytes after the buffer.
        let ways = [[space, space, end], [0, 0, end], [space, 0, end], [0, 0, 0], [space, space, 0]];
        let [padded, counted, last] = ways[way];
        let word = |n: usize| (n as u32).to_le_bytes().to_vec();
        let length = 28 + json.len() + padded + self.bytes.len() + end;
        let head =
            [b"glTF".to_vec(), word(2), word(length), word(json.len() + counted), b"JSON".to_vec(), json].concat();
        let fill = if way == 4 { 0 } else { b' ' };
        let chunk = [word(self.bytes.len() + end), b"BIN\0".to_vec(), self.bytes.clone(), vec![0; last]].concat();
        [head, vec![fill; padded], chunk].concat()
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
