//! glTF files: JSON in a shorthand, so that short inputs can be files with many of anything; after a zero byte, the
//! binary chunk.
//!
//! The shorthand: the item `["*", 3, x]` of a list is x three times; the key `"COLOR_*3"` is COLOR_0, COLOR_1 and
//! COLOR_2; the text `"ab*3"` is "ababab"; and in them `"#"` is the number of the repetition, from 0 on. The binary
//! chunk is also written by itself, as `a.bin` beside the file `a.glb`. An input that begins with `glTF` is a whole
//! file.

use crate::{Memory, Random, Target, bounded, check_error, pack_and_update, parts, write};
use deltamorph::Tolerance;
use deltamorph::import::gltf::{self, Gltf};
use serde_json::{Value, json};
use std::sync::LazyLock;

pub const TARGET: Target = Target { name: "gltf", run, mutate, seeds: Vec::new };

/// The bound in src/import/gltf/tests/hostile.rs.
const MEMORY: Memory = Memory { base: 3 << 20, per_byte: 960 };
/// Inputs whose files are longer are skipped.
const LONGEST: usize = 128 << 10;

fn run(data: &[u8]) {
    let Some((glb, binary)) = file(data) else { return };
    let path = write("a.glb", &glb);
    write("a.bin", binary);
    // Buffers beside the file count as bytes of the file.
    let size = glb.len() + if glb.windows(5).any(|name| name == b"a.bin") { binary.len() } else { 0 };
    let read = match bounded("gltf::read", size, MEMORY, || gltf::read(&path)) {
        Ok(read) => read,
        Err(error) => return check_error(error),
    };
    bounded("animations", size, Memory { base: 256 << 20, per_byte: 960 }, || animations(&read));
    let mut source = match bounded("Gltf::into_mesh", size, MEMORY, || read.into_mesh()) {
        Ok(source) => source,
        Err(error) => return check_error(error),
    };
    let choice = crc32fast::hash(data);
    if choice.is_multiple_of(4) {
        match source.split() {
            Ok(split) => source = split,
            Err(error) => check_error(error),
        }
    }
    let tolerance = if choice.is_multiple_of(2) { Tolerance::default() } else { Tolerance::ZERO };
    // In addition to the source, which may be as large as reading allows.
    let memory = Memory { per_byte: 2 * MEMORY.per_byte, ..MEMORY };
    match bounded("Mesh::pack", size, memory, || source.kept(tolerance)) {
        Ok(mesh) => pack_and_update(&mesh, choice / 8),
        Err(error) => check_error(error),
    }
}

fn animations(read: &Gltf) {
    for animation in read.animations.iter().take(20) {
        for time in [-1.0, 0.4, 1e9] {
            let worlds = read.world_matrices(Some((animation, time)));
            for skin in read.skins.iter().take(20) {
                assert_eq!(read.joint_matrices(skin, &worlds).len(), skin.joints.len());
            }
        }
        match read.clip(animation, None) {
            Ok(clip) => assert_eq!(clip.values.len(), clip.frame_count() * clip.names.len()),
            Err(error) => check_error(error),
        }
    }
}

/// Returns the file that an input stands for, and the content of the file beside it. `None`: too long.
fn file(data: &[u8]) -> Option<(Vec<u8>, &[u8])> {
    if data.starts_with(b"glTF") {
        return Some((data.to_vec(), &[]));
    }
    let [text, binary] = parts(data);
    let mut json = String::new();
    let json = match serde_json::from_slice(text) {
        Ok(value) => expand(&value, 0, &mut json).then_some(json.into_bytes())?,
        Err(_) => text.to_vec(),
    };
    Some((glb(&json, binary), binary))
}

fn glb(json: &[u8], binary: &[u8]) -> Vec<u8> {
    let word = |word: usize| (word as u32).to_le_bytes();
    let [spaces, zeros] = [json, binary].map(|part| part.len().next_multiple_of(4) - part.len());
    let length = 28 + json.len() + spaces + binary.len() + zeros;
    let head = [*b"glTF", word(2), word(length), word(json.len() + spaces), *b"JSON"].concat();
    let tail = [word(binary.len() + zeros), *b"BIN\0"].concat();
    [&head, json, &b"   "[..spaces], &tail, binary, &[0; 3][..zeros]].concat()
}

/// Expands the shorthand; returns whether the result is short enough. `number` is that of the repetition.
fn expand(value: &Value, number: usize, out: &mut String) -> bool {
    match value {
        Value::Array(items) => {
            out.push('[');
            for item in items {
                let (count, item) = repeated(item).map_or((None, item), |(count, item)| (Some(count), item));
                for i in 0..count.unwrap_or(1) {
                    if !expand(item, if count.is_some() { i } else { number }, out) {
                        return false;
                    }
                    out.push(',');
                }
            }
            close(out, ']')
        }
        Value::Object(map) => {
            out.push('{');
            for (key, value) in map {
                let repeated = key.split_once('*').and_then(|(key, count)| Some((key, count.parse::<usize>().ok()?)));
                for i in 0..repeated.map_or(1, |(_, count)| count) {
                    let (key, i) = repeated.map_or((key.clone(), number), |(key, _)| (format!("{key}{i}"), i));
                    out.push_str(&Value::String(key).to_string());
                    out.push(':');
                    if !expand(value, i, out) {
                        return false;
                    }
                    out.push(',');
                }
            }
            close(out, '}')
        }
        Value::String(text) if text == "#" => out.push_str(&number.to_string()),
        Value::String(text) => {
            let repeated = text.split_once('*').and_then(|(text, count)| Some((text, count.parse::<usize>().ok()?)));
            match repeated {
                Some((text, count)) if text.len().saturating_mul(count) > LONGEST => return false,
                Some((text, count)) => out.push_str(&Value::String(text.repeat(count)).to_string()),
                None => out.push_str(&value.to_string()),
            }
        }
        other => out.push_str(&other.to_string()),
    }
    out.len() <= LONGEST
}

/// Writes the end of a list, replacing its last comma.
fn close(out: &mut String, end: char) {
    if out.ends_with(',') {
        out.pop();
    }
    out.push(end);
}

fn repeated(item: &Value) -> Option<(usize, &Value)> {
    match item.as_array()?.as_slice() {
        [star, count, item] if star == "*" => Some((count.as_u64()?.min(LONGEST as u64) as usize, item)),
        _ => None,
    }
}

/// Properties of glTF and their values; a mutation puts one into any object, or its value in place of another one.
static PROPERTIES: LazyLock<Vec<(String, Value)>> = LazyLock::new(|| {
    let text = r##"[["byteStride",0],["byteStride",4],["byteStride",16],["byteStride","18446744073709551615"],
        ["byteOffset",2],
        ["byteLength",16],["count",3],["count",100000],["count",10000000],["normalized",true],["componentType",5121],
        ["componentType",5125],["type","VEC4"],
        ["sparse",{"count":2,"indices":{"bufferView":0,"componentType":5121},"values":{"bufferView":0}}],
        ["bufferView",0],
        ["uri","a.glb"],["uri","a.bin"],["uri","data:application/octet-stream;base64,AAAA*99"],["uri","data:,"],
        ["fallback",true],
        ["name","a"],["name","a*1000"],["name","\u00e4"],["extras",{"targetNames":["a",["*",100,"a"]]}],
        ["weights",[1]],["weights",[]],["weights",[["*",1000,0]]],
        ["NORMAL",0],["TANGENT",0],["TEXCOORD_0",0],["COLOR_0",0],["TEXCOORD_*64",3],["COLOR_*64",4],["JOINTS_*2",0],
        ["WEIGHTS_*2",0],["_*100",0],
        ["indices",0],["mode",5],["mode",6],["mode",0],["material","#"],["targets",[["*",1000,{}]]],
        ["targets",[{"POSITION":0,"NORMAL":0}]],
        ["mesh","#"],["mesh",0],["skin",0],["children",["#"]],["children",[["*",1000,"#"]]],
        ["joints",[["*",100,"#"]]],["inverseBindMatrices",0],["skeleton",0],
        ["matrix",[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]],["translation",[1,2,3]],["rotation",[0,0,0,1]],["scale",[0,0,0]],
        ["interpolation","STEP"],["interpolation","CUBICSPLINE"],["path","weights"],["path","rotation"],["node",0],
        ["input",0],["output",0],["sampler",0],
        ["extensions",{"EXT_meshopt_compression":{"buffer":0,"byteLength":40,"byteStride":4,"count":16,
        "mode":"ATTRIBUTES","filter":"OCTAHEDRAL"}}],
        ["mode","TRIANGLES"],["mode","INDICES"],["filter","EXPONENTIAL"],["filter","QUATERNION"],
        ["",0],["",1],["",-1],["",0.5],["",255],["",65536],["",4294967295],["",18446744073709551615],["",1e39],
        ["",1e-46],["",null],["",{}],["",[]],["",[["*",1000,[]]]]]"##;
    serde_json::from_str(text).expect("a list of pairs")
});

/// Exchanges and moves values, repeats items, and changes words of the binary chunk.
fn mutate(data: &[u8], random: &mut Random) -> Option<Vec<u8>> {
    let [text, binary] = parts(data);
    let mut json: Value = serde_json::from_slice(text).ok()?;
    let mut binary = binary.to_vec();
    for _ in 0..1 + random.below(4) {
        if random.below(8) == 0 {
            random.change_word(&mut binary);
            continue;
        }
        let mut places = vec![];
        places_of(&json, &mut String::new(), &mut places);
        let other = json.pointer(random.choose::<String>(&places)).cloned().unwrap_or_default();
        change(json.pointer_mut(random.choose::<String>(&places)).expect("a place"), other, random);
    }
    Some([json.to_string().as_bytes(), b"\0", &binary].concat())
}

/// Collects JSON pointers to all values.
fn places_of(value: &Value, at: &mut String, places: &mut Vec<String>) {
    places.push(at.clone());
    let length = at.len();
    let mut below = |key: &str, value| {
        at.push('/');
        at.push_str(&key.replace('~', "~0").replace('/', "~1"));
        places_of(value, at, places);
        at.truncate(length);
    };
    match value {
        Value::Array(items) => items.iter().enumerate().for_each(|(i, item)| below(&i.to_string(), item)),
        Value::Object(map) => map.iter().for_each(|(key, value)| below(key, value)),
        _ => {}
    }
}

fn change(value: &mut Value, other: Value, random: &mut Random) {
    let (key, property) = random.choose(&PROPERTIES).clone();
    // Small counts more often, since large ones take time.
    let most = 1 + random.below(12);
    let count = json!((1usize << random.below(most)) + random.below(3));
    match value {
        Value::Array(items) if !items.is_empty() => {
            let (from, to) = (random.below(items.len()), random.below(items.len()));
            match random.below(8) {
                0 => _ = items.remove(from),
                1 => items.insert(to, items[from].clone()),
                2 => items.insert(to, other),
                3 => items[to] = property,
                4 => items.swap(from, to),
                _ if repeated(&items[from]).is_some() => items[from][1] = count,
                _ => items[from] = json!(["*", count, items[from]]),
            }
        }
        Value::Object(map) => {
            let keys: Vec<String> = map.keys().cloned().collect();
            match random.below(4) {
                0 if !keys.is_empty() => _ = map.remove(random.choose(&keys)),
                1 if !keys.is_empty() => _ = map.insert(random.choose(&keys).clone(), other),
                2 if keys.iter().any(|key| key.contains('*')) => {
                    let key = keys.iter().find(|key| key.contains('*')).expect("there is one");
                    let value = map.remove(key).unwrap_or_default();
                    map.insert(format!("{}*{count}", key.split('*').next().unwrap_or_default()), value);
                }
                _ => _ = map.insert(key, property),
            }
        }
        Value::Number(_) => {
            let small = json!(random.below(24));
            *value = random.choose(&[small, count, other, property]).clone();
        }
        _ => *value = random.choose(&[other, property]).clone(),
    }
}
