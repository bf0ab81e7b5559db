//! What a glTF file draws, evaluated in float64 by the formulas of glTF 2.0. Uses no code of the reader or of the
//! library: JSON is read by serde_json, compressed views by meshoptimizer. Files are trusted.

use glam::{DMat3, DMat4, DQuat, DVec3};
use serde_json::Value;
use std::cell::RefCell;
use std::collections::HashMap;
use std::path::Path;
use std::rc::Rc;

/// A clip of the file, and a time.
pub type Playing = Option<(usize, f64)>;

pub struct File {
    json: Value,
    /// The bytes of each buffer view, and from element to element.
    views: Vec<(Vec<u8>, Option<usize>)>,
    parents: Vec<Option<usize>>,
    /// Whether a node is in the scene.
    shown: Vec<bool>,
    /// Keys of each animation, and the only target that they drive.
    animations: Vec<Vec<(Keys, Option<usize>)>>,
    numbers: RefCell<HashMap<usize, Rc<Vec<f64>>>>,
}

/// A mesh, and a node that draws it.
pub type Drawn = (usize, usize);

/// Keys of a node's property.
struct Keys {
    node: usize,
    path: &'static str,
    interpolation: &'static str,
    times: Vec<f32>,
    width: usize,
    values: Vec<f64>,
}

impl Keys {
    /// Returns the elements of a key.
    fn at(&self, i: usize) -> &[f64] {
        &self.values[i * self.width..][..self.width]
    }

    /// Samples a track, by glTF 2.0, appendix C.
    fn sample(&self, time: f64) -> Vec<f64> {
        let time = time.clamp(self.times[0].into(), self.times[self.times.len() - 1].into());
        let is_spline = self.interpolation == "CUBICSPLINE";
        let value = |key: usize| self.at(if is_spline { 3 * key + 1 } else { key });
        let last = self.times.iter().rposition(|t| f64::from(*t) <= time).unwrap();
        if last + 1 == self.times.len() || self.interpolation == "STEP" {
            return value(last).to_vec();
        }
        let [start, end] = [last, last + 1].map(|key| f64::from(self.times[key]));
        let (length, t) = (end - start, (time - start) / (end - start));
        let (from, to) = (value(last), value(last + 1));
        if is_spline {
            let (out, into) = (self.at(3 * last + 2), self.at(3 * (last + 1)));
            let (t2, t3) = (t.powi(2), t.powi(3));
            let of = |i: usize| {
                (2.0 * t3 - 3.0 * t2 + 1.0) * from[i]
                    + length * (t3 - 2.0 * t2 + t) * out[i]
                    + (-2.0 * t3 + 3.0 * t2) * to[i]
                    + length * (t3 - t2) * into[i]
            };
            return (0..from.len()).map(of).collect();
        }
        let (mut a, mut b) = (1.0 - t, t);
        if self.path == "rotation" {
            let lengths = dot(from, from).sqrt() * dot(to, to).sqrt();
            let cosine = dot(from, to) / lengths;
            let angle = cosine.abs().min(1.0).acos();
            if angle > 1e-9 {
                a = (angle * (1.0 - t)).sin() / angle.sin() / dot(from, from).sqrt();
                b = (angle * t).sin() / angle.sin() / dot(to, to).sqrt() * cosine.signum();
            }
        }
        from.iter().zip(to).map(|(from, to)| a * from + b * to).collect()
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn list<'a>(value: &'a Value, key: &str) -> &'a [Value] {
    value[key].as_array().map_or(&[], Vec::as_slice)
}

fn whole(value: &Value) -> Option<usize> {
    value.as_u64().map(|number| number as usize)
}

fn floats(value: &Value) -> Option<Vec<f64>> {
    Some(value.as_array()?.iter().map(|x| x.as_f64().expect("a number")).collect())
}

fn base64(text: &str) -> Vec<u8> {
    let six = |letter: u8| match letter {
        b'A'..=b'Z' => letter - b'A',
        b'a'..=b'z' => letter - b'a' + 26,
        b'0'..=b'9' => letter - b'0' + 52,
        b'+' => 62,
        _ => 63,
    };
    let letters: Vec<u8> = text.bytes().filter(|letter| *letter != b'=').map(six).collect();
    let three = |four: &[u8]| {
        let bits = four.iter().enumerate().fold(0u32, |bits, (i, six)| bits | u32::from(*six) << (26 - 6 * i));
        bits.to_be_bytes()[..four.len() * 3 / 4].to_vec()
    };
    letters.chunks(4).flat_map(three).collect()
}

/// Decodes a view of EXT_meshopt_compression or KHR_meshopt_compression; those of indices stay empty.
fn decompressed(stated: &Value, data: &[u8]) -> Vec<u8> {
    let [count, stride] = ["count", "byteStride"].map(|key| whole(&stated[key]).unwrap());
    if stated["mode"] != "ATTRIBUTES" {
        return vec![];
    }
    let mut bytes = vec![0u8; count * stride];
    let to = bytes.as_mut_ptr().cast();
    // SAFETY: `bytes` has `count` elements of `stride` bytes, `data` has its length.
    let failed = unsafe { meshopt::ffi::meshopt_decodeVertexBuffer(to, count, stride, data.as_ptr(), data.len()) };
    assert_eq!(failed, 0, "meshoptimizer decodes the view");
    // SAFETY: as above; the filters work in place.
    unsafe {
        match stated["filter"].as_str() {
            Some("OCTAHEDRAL") => meshopt::ffi::meshopt_decodeFilterOct(to, count, stride),
            Some("QUATERNION") => meshopt::ffi::meshopt_decodeFilterQuat(to, count, stride),
            Some("EXPONENTIAL") => meshopt::ffi::meshopt_decodeFilterExp(to, count, stride),
            Some("COLOR") => meshopt::ffi::meshopt_decodeFilterColor(to, count, stride),
            _ => {}
        }
    }
    bytes
}

impl File {
    pub fn read(path: &Path) -> Self {
        let bytes = std::fs::read(path).unwrap();
        let chunk = |at: usize| {
            let size = bytes.get(at..at + 4).map_or(0, |size| u32::from_le_bytes(size.try_into().unwrap()));
            bytes.get(at + 8..at + 8 + size as usize).unwrap_or_default()
        };
        let (json, own) = match bytes.starts_with(b"glTF") {
            true => (chunk(12), chunk(20 + chunk(12).len())),
            false => (&bytes[..], &[][..]),
        };
        let json: Value = serde_json::from_slice(json).unwrap();
        let buffer = |buffer: &Value| match buffer["uri"].as_str() {
            None => own.to_vec(),
            Some(uri) => match uri.split_once(";base64,") {
                Some((_, text)) => base64(text),
                None => std::fs::read(path.with_file_name(uri.replace("%20", " "))).unwrap(),
            },
        };
        let buffers: Vec<Vec<u8>> = list(&json, "buffers").iter().map(buffer).collect();
        let part = |stated: &Value| {
            let (first, count) = (whole(&stated["byteOffset"]).unwrap_or(0), whole(&stated["byteLength"]).unwrap());
            // Nothing of a view that no mesh uses may be there.
            buffers[whole(&stated["buffer"]).unwrap()].get(first..first + count).unwrap_or_default().to_vec()
        };
        let view = |view: &Value| {
            let packed = ["EXT_meshopt_compression", "KHR_meshopt_compression"];
            match packed.iter().find_map(|name| view["extensions"].get(name)) {
                Some(packed) => (decompressed(packed, &part(packed)), whole(&packed["byteStride"])),
                None => (part(view), whole(&view["byteStride"])),
            }
        };
        let views = list(&json, "bufferViews").iter().map(view).collect();
        let nodes = list(&json, "nodes");
        let (mut parents, mut shown) = (vec![None; nodes.len()], vec![json["scenes"].is_null(); nodes.len()]);
        for (parent, node) in nodes.iter().enumerate() {
            list(node, "children").iter().for_each(|child| parents[whole(child).unwrap()] = Some(parent));
        }
        let scene = list(&json, "scenes").get(whole(&json["scene"]).unwrap_or(0)).unwrap_or(&Value::Null);
        let mut below: Vec<usize> = list(scene, "nodes").iter().filter_map(whole).collect();
        while let Some(node) = below.pop() {
            shown[node] = true;
            below.extend(list(&nodes[node], "children").iter().filter_map(whole));
        }
        let mut file = Self { views, parents, shown, animations: vec![], numbers: RefCell::default(), json };
        file.animations = list(&file.json, "animations").iter().map(|a| file.animation(a)).collect();
        file
    }

    /// Returns numbers in a view: normalised integers by glTF 2.0, 3.11.
    fn stored(&self, stated: &Value, component: &Value, (count, width): (usize, usize), normalised: bool) -> Vec<f64> {
        let (bytes, stride) = &self.views[whole(&stated["bufferView"]).unwrap()];
        let first = whole(&stated["byteOffset"]).unwrap_or(0);
        type Read = fn(&[u8]) -> f64;
        let (size, one, read): (usize, f64, Read) = match component.as_u64().unwrap() {
            5120 => (1, 127.0, |b| f64::from(b[0] as i8)),
            5121 => (1, 255.0, |b| f64::from(b[0])),
            5122 => (2, 32767.0, |b| f64::from(i16::from_le_bytes([b[0], b[1]]))),
            5123 => (2, 65535.0, |b| f64::from(u16::from_le_bytes([b[0], b[1]]))),
            5125 => (4, 1.0, |b| f64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]]))),
            _ => (4, 1.0, |b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]))),
        };
        let stride = stride.unwrap_or(width * size);
        let number = |at: usize| match read(&bytes[at..]) {
            x if normalised => (x / one).max(-1.0),
            x => x,
        };
        let element = |i: usize| (0..width).map(move |c| first + i * stride + c * size);
        (0..count).flat_map(element).map(number).collect()
    }

    /// Returns the numbers of an accessor, one element after the other.
    fn numbers(&self, index: &Value) -> Rc<Vec<f64>> {
        let index = whole(index).unwrap();
        if let Some(known) = self.numbers.borrow().get(&index) {
            return known.clone();
        }
        let stated = &self.json["accessors"][index];
        let width = match stated["type"].as_str().unwrap() {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "MAT4" => 16,
            _ => 4,
        };
        let (count, normalised) = (whole(&stated["count"]).unwrap(), stated["normalized"] == true);
        let mut numbers = match stated.get("bufferView") {
            Some(_) => self.stored(stated, &stated["componentType"], (count, width), normalised),
            None => vec![0.0; count * width],
        };
        if let Some(sparse) = stated.get("sparse") {
            let (count, indices) = (whole(&sparse["count"]).unwrap(), &sparse["indices"]);
            let places = self.stored(indices, &indices["componentType"], (count, 1), false);
            let values = self.stored(&sparse["values"], &stated["componentType"], (count, width), normalised);
            for (place, value) in places.iter().zip(values.chunks_exact(width)) {
                numbers[*place as usize * width..][..width].copy_from_slice(value);
            }
        }
        let numbers = Rc::new(numbers);
        self.numbers.borrow_mut().insert(index, numbers.clone());
        numbers
    }

    fn node(&self, node: usize) -> &Value {
        &self.json["nodes"][node]
    }

    /// Returns the number of targets of a mesh.
    pub fn targets(&self, mesh: usize) -> usize {
        list(&list(&self.json["meshes"][mesh], "primitives")[0], "targets").len()
    }

    /// Returns the meshes in the scene with targets, or those without, each as often as a node draws it.
    pub fn drawn(&self, with_targets: bool) -> Vec<Drawn> {
        let meshes = 0..list(&self.json, "meshes").len();
        let nodes = |mesh: usize| {
            let draws = move |node: &usize| self.shown[*node] && whole(&self.node(*node)["mesh"]) == Some(mesh);
            (0..self.parents.len()).filter(draws).map(move |node| (mesh, node))
        };
        meshes.filter(|mesh| (self.targets(*mesh) > 0) == with_targets).flat_map(nodes).collect()
    }

    /// Returns the keys of an animation, and the only target that they drive; KHR_animation_pointer may drive weights.
    fn animation(&self, stated: &Value) -> Vec<(Keys, Option<usize>)> {
        let mut found = vec![];
        for channel in list(stated, "channels") {
            let target = &channel["target"];
            let pointer = target["extensions"]["KHR_animation_pointer"]["pointer"].as_str().unwrap_or_default();
            let parts: Vec<&str> = pointer.split('/').skip(1).collect();
            let (nodes, path, one) = match (whole(&target["node"]), &parts[..]) {
                (Some(node), _) => (vec![node], target["path"].as_str().unwrap(), None),
                (None, [list @ ("nodes" | "meshes"), number, path, more @ ..]) => {
                    let number: usize = number.parse().unwrap();
                    let takes = |node: &usize| {
                        whole(&self.node(*node)["mesh"]) == Some(number) && self.node(*node)["weights"].is_null()
                    };
                    let nodes = match *list {
                        "nodes" => vec![number],
                        _ => (0..self.parents.len()).filter(takes).collect(),
                    };
                    (nodes, *path, more.first().map(|target| target.parse().unwrap()))
                }
                _ => continue,
            };
            let Some(path) = ["translation", "rotation", "scale", "weights"].into_iter().find(|known| *known == path)
            else {
                continue;
            };
            let sampler = &list(stated, "samplers")[whole(&channel["sampler"]).unwrap()];
            let interpolation = match sampler["interpolation"].as_str() {
                Some("STEP") => "STEP",
                Some("CUBICSPLINE") => "CUBICSPLINE",
                _ => "LINEAR",
            };
            let [times, values] = ["input", "output"].map(|key| self.numbers(&sampler[key]));
            let each = times.len() * if interpolation == "CUBICSPLINE" { 3 } else { 1 };
            let times: Vec<f32> = times.iter().map(|time| *time as f32).collect();
            let width = values.len() / each;
            found.extend(nodes.into_iter().map(|node| {
                (Keys { node, path, interpolation, times: times.clone(), width, values: values.to_vec() }, one)
            }));
        }
        found
    }

    /// Returns the value of a node's property at a time, if the animation drives it; `at` is where a single weight
    /// goes.
    fn played(&self, playing: Playing, node: usize, path: &str, rest: Vec<f64>) -> Vec<f64> {
        let Some((animation, time)) = playing else { return rest };
        let driving = self.animations[animation].iter().filter(|(keys, _)| (keys.node, keys.path) == (node, path));
        driving.fold(rest, |mut value, (keys, one)| {
            match one {
                Some(target) => value[*target] = keys.sample(time)[0],
                None => value = keys.sample(time),
            }
            value
        })
    }

    /// Returns the weights with which a node draws a mesh.
    pub fn weights(&self, (mesh, node): Drawn, playing: Playing) -> Vec<f64> {
        let stated = [self.node(node), &self.json["meshes"][mesh]].into_iter().find_map(|at| floats(&at["weights"]));
        let mut rest = stated.unwrap_or_default();
        rest.resize(self.targets(mesh), 0.0);
        self.played(playing, node, "weights", rest)
    }

    /// Returns the matrix of each node, from its own space to the scene's.
    pub fn worlds(&self, playing: Playing) -> Vec<DMat4> {
        let local = |node: usize| {
            let stated = self.node(node);
            if let Some(matrix) = floats(&stated["matrix"]) {
                return DMat4::from_cols_slice(&matrix);
            }
            let rest = [("translation", vec![0.0; 3]), ("rotation", vec![0.0, 0.0, 0.0, 1.0]), ("scale", vec![1.0; 3])];
            let [t, r, s] =
                rest.map(|(path, default)| self.played(playing, node, path, floats(&stated[path]).unwrap_or(default)));
            // A rotation may have any length but 0.
            let rotation = DQuat::from_slice(&r).normalize();
            DMat4::from_scale_rotation_translation(DVec3::from_slice(&s), rotation, DVec3::from_slice(&t))
        };
        let world = |node: usize| {
            let line = std::iter::successors(Some(node), |node| self.parents[*node]);
            line.map(local).reduce(|below, above| above * below).unwrap()
        };
        (0..self.parents.len()).map(world).collect()
    }

    /// Returns positions, and normals of any length, of the vertices of all triangles that a node draws with these
    /// weights; a normal that the file does not state is 0.
    pub fn vertices(&self, (mesh, node): Drawn, weights: &[f64], worlds: &[DMat4]) -> Vec<[DVec3; 2]> {
        let joints: Option<Vec<DMat4>> = whole(&self.node(node)["skin"]).map(|skin| {
            let skin = &self.json["skins"][skin];
            let bind = skin.get("inverseBindMatrices").map(|index| self.numbers(index));
            let bind = |i: usize| bind.as_ref().map_or(DMat4::IDENTITY, |m| DMat4::from_cols_slice(&m[16 * i..]));
            let joints = list(skin, "joints").iter().map(|joint| whole(joint).unwrap());
            joints.enumerate().map(|(i, joint)| worlds[joint] * bind(i)).collect()
        });
        let mut all = vec![];
        for primitive in list(&self.json["meshes"][mesh], "primitives") {
            if !(4..=6).contains(&whole(&primitive["mode"]).unwrap_or(4)) {
                continue;
            }
            let attributes = &primitive["attributes"];
            let morphed = |name: &str| -> Option<Vec<f64>> {
                let mut numbers = self.numbers(attributes.get(name)?).to_vec();
                let targets = list(primitive, "targets").iter().zip(weights);
                for (deltas, weight) in targets.filter_map(|(target, weight)| Some((target.get(name)?, weight))) {
                    numbers.iter_mut().zip(self.numbers(deltas).iter()).for_each(|(n, d)| *n += weight * d);
                }
                Some(numbers)
            };
            let positions = morphed("POSITION").unwrap();
            let normals = morphed("NORMAL").unwrap_or_else(|| vec![0.0; positions.len()]);
            let set = |set: usize| {
                let of = |name: &str| attributes.get(format!("{name}_{set}")).map(|index| self.numbers(index));
                of("JOINTS").zip(of("WEIGHTS"))
            };
            let sets: Vec<_> = (0..).map_while(set).collect();
            for (v, (p, n)) in positions.chunks_exact(3).zip(normals.chunks_exact(3)).enumerate() {
                let mut matrix = worlds[node];
                if let Some(joints) = &joints {
                    let each = sets.iter().flat_map(|(j, w)| j[4 * v..][..4].iter().zip(&w[4 * v..][..4]));
                    let each: Vec<_> = each.filter(|(_, weight)| **weight > 0.0).collect();
                    let sum: f64 = each.iter().map(|(_, weight)| **weight).sum();
                    matrix = each.iter().map(|(joint, weight)| joints[**joint as usize] * (**weight / sum)).sum();
                }
                let normals = DMat3::from_mat4(matrix).inverse().transpose();
                all.push([matrix.transform_point3(DVec3::from_slice(p)), normals * DVec3::from_slice(n)]);
            }
        }
        all
    }
}
