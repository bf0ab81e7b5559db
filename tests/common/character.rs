//! A character written as glTF: a tube of rings with three morph targets, four joints below a scaled and turned rig,
//! three animations.

use crate::file::{I8, I16, U8, U16, Written, bytes};
use crate::numbers::Numbers;
use crate::skinned::{inverse, matrix_of, product};
use serde_json::{Value, json};
use std::f64::consts::TAU;

/// The transform of a node.
#[derive(Clone)]
pub enum Place {
    Parts {
        translation: [f32; 3],
        rotation: [f32; 4],
        scale: [f32; 3],
    },
    /// In column-major order.
    Matrix([f32; 16]),
}

pub struct Node {
    pub parent: Option<usize>,
    pub place: Place,
}

/// Keys of a node's property.
pub struct Keys {
    pub node: usize,
    pub path: &'static str,
    pub interpolation: &'static str,
    pub times: Vec<f32>,
    pub values: Numbers,
}

/// Base and targets of an attribute.
pub struct Morphed {
    pub base: Numbers,
    pub targets: Vec<Numbers>,
}

/// The storage of a character.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stored {
    Floats,
    /// KHR_mesh_quantization; the inverse bind matrices undo it, since nodes of skinned meshes have no effect.
    Quantised,
    /// Quantised and compressed by this extension, whose attributes have this version.
    Compressed(&'static str, u32),
}

pub struct Character {
    pub stored: Stored,
    pub positions: Morphed,
    pub normals: Morphed,
    /// Sets of four joints and weights per vertex.
    pub joints: Vec<Numbers>,
    pub weights: Vec<Numbers>,
    pub indices: Vec<u16>,
    pub nodes: Vec<Node>,
    /// The nodes that are joints.
    pub skin: Vec<usize>,
    pub inverse_bind: Numbers,
    /// Weights of the node that draws the mesh.
    pub node_weights: Vec<f32>,
    pub animations: Vec<Vec<Keys>>,
}

/// The node that draws the mesh.
pub const MESH_NODE: usize = 0;
const RINGS: usize = 25;
const AROUND: usize = 16;

/// Iterates over vertices: position along the tube, and angle.
fn tube() -> impl Iterator<Item = (f64, f64)> {
    (0..RINGS * AROUND).map(|v| ((v / AROUND) as f64 / (RINGS - 1) as f64, (v % AROUND) as f64 / AROUND as f64 * TAU))
}

fn normalised(v: [f64; 3]) -> [f64; 3] {
    let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    v.map(|x| x / length)
}

fn turn(axis: [f64; 3], angle: f64) -> [f64; 4] {
    let [x, y, z] = normalised(axis).map(|x| x * (angle / 2.0).sin());
    [x, y, z, (angle / 2.0).cos()]
}

impl Character {
    /// Makes a character with 4 or 8 influences.
    pub fn new(stored: Stored, influences: usize) -> Self {
        let is_quantised = stored != Stored::Floats;
        // A quantised position is the number × step + least.
        let (step, least) = if is_quantised { (4.0 / 16383.0, -2.0) } else { (1.0, 0.0) };
        let vectors = |f: &dyn Fn(f64, f64) -> [f64; 3]| tube().flat_map(|(u, a)| f(u, a)).collect::<Vec<f64>>();
        let base = vectors(&|u, a| [(0.3 + 0.1 * (7.0 * u).sin()) * a.cos(), 4.0 * u - 2.0, 0.3 * a.sin()]);
        let moves: [Vec<f64>; 3] = [
            vectors(&|u, a| [0.2 * a.cos() * (-30.0 * (u - 0.5).powi(2)).exp(), 0.0, 0.1 * a.sin() * u]),
            vectors(&|u, a| [0.0, if u > 0.7 { 0.3 * (a - 1.0).sin() } else { 0.0 }, -0.2 * u * u]),
            vectors(&|u, a| [0.05 * (9.0 * a).cos(), -0.1 * (5.0 * u).sin(), 0.07 * u]),
        ];
        let turns: [Vec<f64>; 3] =
            [0.3, -0.4, 0.2].map(|s| vectors(&|u, a| [s * u, s * (3.0 * a).sin(), s * s - u * s]));
        let normals = vectors(&|u, a| normalised([a.cos(), 0.3 * (4.0 * u).cos(), a.sin()]));
        let morphed = |width, base: Vec<f64>, targets: &[Vec<f64>; 3]| Morphed {
            base: match is_quantised {
                true => Numbers::integers(I8, true, width, base),
                false => Numbers::floats(width, base),
            },
            targets: targets
                .iter()
                .map(|target| match is_quantised {
                    true => Numbers::integers(I8, true, 3, target.iter().copied()),
                    false => Numbers::floats(3, target.iter().copied()),
                })
                .collect(),
        };
        let positions = Morphed {
            base: match is_quantised {
                true => Numbers::integers(U16, false, 3, base.iter().map(|x| (x - least) / step)),
                false => Numbers::floats(3, base),
            },
            targets: moves
                .iter()
                .map(|target| match is_quantised {
                    true => Numbers::integers(I16, false, 3, target.iter().map(|x| x / step)),
                    false => Numbers::floats(3, target.iter().copied()),
                })
                .collect(),
        };
        let (joints, weights) = Self::influences(is_quantised, influences);

        // The rig and a joint come after their child nodes. The transform of the mesh's own node has no effect.
        let parts = |translation: [f32; 3], axis, angle, scale: [f32; 3]| Place::Parts {
            translation,
            rotation: turn(axis, angle).map(|x| x as f32),
            scale,
        };
        let spine = matrix_of(&[0.1, 1.2, 0.0], &turn([1.0, 0.0, 1.0], 0.3), &[1.0; 3]);
        let rig = parts([0.2, -1.9, 0.1], [1.0, 2.0, 3.0], 0.7, [1.1, 0.8, 1.3]);
        let nodes = vec![
            Node { parent: Some(5), place: parts([9.0, 9.0, 9.0], [0.0, 1.0, 0.0], 1.0, [3.0, 3.0, 3.0]) },
            Node { parent: Some(3), place: parts([0.0, 0.9, 0.1], [0.0, 0.0, 1.0], 0.4, [1.0, 1.2, 0.9]) },
            Node { parent: Some(5), place: parts([0.1, 0.2, -0.1], [1.0, 0.0, 0.0], -0.2, [0.9, 1.1, 1.0]) },
            Node { parent: Some(2), place: Place::Matrix(columns(&spine)) },
            Node { parent: Some(3), place: parts([0.4, 0.1, 0.0], [1.0, 1.0, 0.0], -0.9, [0.7, 1.0, 1.4]) },
            Node { parent: None, place: rig },
        ];
        let skin = vec![4, 1, 2, 3];
        let mut character = Self {
            stored,
            positions,
            normals: morphed(3, normals, &turns),
            joints,
            weights,
            indices: triangles(),
            nodes,
            skin,
            inverse_bind: Numbers::floats(16, []),
            node_weights: vec![0.25, -0.5, 0.75],
            animations: animations(is_quantised),
        };
        // The bind pose: joints at rest, except for a turn, so that the rest pose is deformed as well.
        let worlds = character.worlds();
        let undo = matrix_of(&[least; 3], &[0.0, 0.0, 0.0, 1.0], &[step; 3]);
        let bind = |&joint: &usize| {
            let turned = matrix_of(&[0.02, 0.0, 0.01], &turn([1.0, 1.0, 1.0], 0.1 * joint as f64), &[1.0; 3]);
            columns(&product(&turned, &product(&inverse(&worlds[joint]), &undo))).map(f64::from)
        };
        character.inverse_bind = Numbers::floats(16, character.skin.iter().flat_map(bind));
        character
    }

    /// Returns joints and weights of each vertex, by its position along the tube.
    fn influences(is_quantised: bool, influences: usize) -> (Vec<Numbers>, Vec<Numbers>) {
        let set = |set: usize| {
            let joint = move |(u, _): (f64, f64)| [0, 1, 2, 3].map(|i| ((i + set + (u * 3.0) as usize) % 4) as f64);
            let weight = move |(u, a): (f64, f64)| {
                [0.0, 1.0, 2.0, 3.0]
                    .map(|i| (a.cos() + 1.5 + u * i - 0.4 * i - set as f64).max(0.0) + (1.0 - i).max(0.0) / 4.0)
            };
            (tube().flat_map(joint).collect::<Vec<f64>>(), tube().map(weight).collect::<Vec<[f64; 4]>>())
        };
        let sets: Vec<_> = (0..influences / 4).map(set).collect();
        let sums: Vec<f64> = (0..RINGS * AROUND).map(|v| sets.iter().flat_map(|(_, w)| w[v]).sum()).collect();
        let share = |weights: &[[f64; 4]]| -> Vec<f64> {
            weights.iter().zip(&sums).flat_map(|(weights, sum)| weights.map(|w| w / sum)).collect()
        };
        let kind = if is_quantised { U8 } else { U16 };
        let joints = sets.iter().map(|(joints, _)| Numbers::integers(kind, false, 4, joints.iter().copied()));
        let weights = sets.iter().map(|(_, weights)| match is_quantised {
            true => Numbers::integers(U8, true, 4, share(weights)),
            false => Numbers::floats(4, share(weights)),
        });
        (joints.collect(), weights.collect())
    }

    /// Writes the file.
    pub fn write(&self) -> Written {
        let mut file = Written::default();
        let mut attributes = json!({
            "POSITION": self.add(&mut file, &self.positions.base), "NORMAL": self.add(&mut file, &self.normals.base),
        });
        for (set, (joints, weights)) in self.joints.iter().zip(&self.weights).enumerate() {
            attributes[format!("JOINTS_{set}")] = json!(self.add(&mut file, joints));
            attributes[format!("WEIGHTS_{set}")] = json!(self.add(&mut file, weights));
        }
        let target = |file: &mut Written, i: usize| {
            let [p, n] = [&self.positions, &self.normals].map(|m| self.add(file, &m.targets[i]));
            json!({"POSITION": p, "NORMAL": n})
        };
        let targets: Vec<Value> = (0..3).map(|i| target(&mut file, i)).collect();
        let indices = file.accessor(U16, "SCALAR", self.indices.len(), &bytes(&self.indices));
        file.json["meshes"] = json!([{"weights": [1.0, 1.0, 1.0], "extras": {"targetNames": ["bulge", "lean", "wrinkle"]},
            "primitives": [{"attributes": attributes, "indices": indices, "targets": targets}]}]);
        let node = |node: &Node| match &node.place {
            Place::Parts { translation, rotation, scale } => {
                json!({"translation": translation, "rotation": rotation, "scale": scale})
            }
            Place::Matrix(matrix) => json!({"matrix": matrix}),
        };
        let mut nodes: Vec<Value> = self.nodes.iter().map(node).collect();
        for (child, parent) in self.nodes.iter().enumerate().filter_map(|(i, node)| Some((i, node.parent?))) {
            let children = nodes[parent].as_object_mut().unwrap().entry("children").or_insert(json!([]));
            children.as_array_mut().unwrap().push(json!(child));
        }
        nodes[MESH_NODE]["mesh"] = json!(0);
        nodes[MESH_NODE]["skin"] = json!(0);
        nodes[MESH_NODE]["weights"] = json!(self.node_weights);
        file.json["nodes"] = json!(nodes);
        file.json["scenes"] = json!([{"nodes": [5]}]);
        file.json["skins"] =
            json!([{"joints": self.skin, "inverseBindMatrices": self.add(&mut file, &self.inverse_bind)}]);
        let mut animation = |(i, channels): (usize, &Vec<Keys>)| {
            let mut sampler = |keys: &Keys| {
                let times = Numbers::floats(1, keys.times.iter().map(|t| f64::from(*t)));
                // Weights are scalars.
                let width = if keys.path == "weights" { 1 } else { keys.values.width };
                let values = keys.values.with_width(width);
                let (input, output) = (self.add(&mut file, &times), self.add(&mut file, &values));
                json!({"input": input, "output": output, "interpolation": keys.interpolation})
            };
            let samplers: Vec<Value> = channels.iter().map(&mut sampler).collect();
            let channel =
                |(i, keys): (usize, &Keys)| json!({"sampler": i, "target": {"node": keys.node, "path": keys.path}});
            let channels: Vec<Value> = channels.iter().enumerate().map(channel).collect();
            json!({"name": format!("clip {i}"), "channels": channels, "samplers": samplers})
        };
        let animations: Vec<Value> = self.animations.iter().enumerate().map(&mut animation).collect();
        file.json["animations"] = json!(animations);
        if let Stored::Compressed(extension, _) = self.stored {
            file.json["buffers"].as_array_mut().unwrap().push(json!({"byteLength": 1 << 24}));
            file.json["extensionsRequired"] = json!(["KHR_mesh_quantization", extension]);
        }
        file
    }

    /// Adds an accessor of these numbers, in a view of its own.
    fn add(&self, file: &mut Written, numbers: &Numbers) -> usize {
        let kind = match numbers.width {
            1 => "SCALAR",
            3 => "VEC3",
            4 => "VEC4",
            _ => "MAT4",
        };
        let stride = numbers.stride();
        let is_compressed = matches!(self.stored, Stored::Compressed(..)) && stride.is_multiple_of(4);
        let data = match self.stored {
            Stored::Compressed(_, version) if is_compressed => compressed(&numbers.bytes, stride, version as i32),
            _ => numbers.bytes.clone(),
        };
        let accessor = file.accessor(numbers.component, kind, numbers.count(), &data);
        file.json["accessors"][accessor]["normalized"] = json!(numbers.normalised);
        let index = file.json["accessors"][accessor]["bufferView"].as_u64().unwrap() as usize;
        let view = &mut file.json["bufferViews"][index];
        if let (Stored::Compressed(extension, _), true) = (self.stored, is_compressed) {
            let mut packed = view.clone();
            (packed["mode"], packed["count"]) = (json!("ATTRIBUTES"), json!(numbers.count()));
            packed["byteStride"] = json!(stride);
            *view = json!({"buffer": 1, "byteLength": numbers.bytes.len(), "extensions": {extension: packed}});
        }
        if numbers.is_padded() {
            view["byteStride"] = json!(stride);
        }
        accessor
    }
}

fn columns(rows: &[[f64; 4]; 4]) -> [f32; 16] {
    std::array::from_fn(|i| rows[i % 4][i / 4] as f32)
}

fn triangles() -> Vec<u16> {
    let quad = |q: usize| {
        let (ring, next) = (q / AROUND * AROUND, (q + 1) % AROUND);
        let [a, b] = [ring + q % AROUND, ring + next].map(|v| v as u16);
        [a, a + AROUND as u16, b, b, a + AROUND as u16, b + AROUND as u16]
    };
    (0..(RINGS - 1) * AROUND).flat_map(quad).collect()
}

fn compressed(data: &[u8], stride: usize, version: i32) -> Vec<u8> {
    fn encode<const N: usize>(data: &[u8], version: i32) -> Vec<u8> {
        ::meshopt::encode_vertex_buffer_level(data.as_chunks::<N>().0, 3, Some(version)).expect("encoded")
    }
    match stride {
        4 => encode::<4>(data, version),
        8 => encode::<8>(data, version),
        12 => encode::<12>(data, version),
        16 => encode::<16>(data, version),
        _ => encode::<64>(data, version),
    }
}

/// Makes three clips: each interpolation for weights and for joints.
fn animations(is_quantised: bool) -> Vec<Vec<Keys>> {
    let keys = |node, path, interpolation, times: &[f32], width, values: Vec<f64>| {
        let short = is_quantised && (path == "rotation" || path == "weights" && interpolation != "CUBICSPLINE");
        // Weights are scalars in the file.
        let in_file = if path == "weights" { 1 } else { width };
        let values = match short {
            true => Numbers::integers(I16, true, in_file, values).with_width(width),
            false => Numbers::floats(width, values),
        };
        Keys { node, path, interpolation, times: times.to_vec(), values }
    };
    let times = [0.25, 0.5, 1.25, 1.5];
    let wave = |n: usize, by: f64| (0..n).map(|i| by * (i as f64 * 1.7).sin()).collect::<Vec<f64>>();
    // Rotations; the third is more than half a turn from the second, so that the shorter arc goes the other way.
    let turns = |axis: [f64; 3]| [0.1, 0.8, 4.5, -0.6].map(|angle| turn(axis, angle));
    // In-tangent, value and out-tangent of each key.
    let spline = |values: Vec<Vec<f64>>, by: f64| {
        let key =
            |(i, v): (usize, Vec<f64>)| [wave(v.len(), by), v.clone(), wave(v.len() + i, -by)[i..].to_vec()].concat();
        values.into_iter().enumerate().flat_map(key).collect::<Vec<f64>>()
    };
    let vectors = |values: Vec<f64>, n: usize| values.chunks_exact(n).map(<[f64]>::to_vec).collect::<Vec<_>>();
    let scales = |n: usize| (0..3 * n).map(|i| 1.0 + 0.3 * (i as f64).sin()).collect::<Vec<f64>>();
    vec![
        vec![
            keys(MESH_NODE, "weights", "LINEAR", &times, 3, wave(12, 0.9)),
            keys(2, "rotation", "LINEAR", &times, 4, turns([0.0, 1.0, 0.5]).concat()),
            keys(4, "translation", "STEP", &times[1..], 3, wave(9, 0.5)),
            keys(
                1,
                "rotation",
                "CUBICSPLINE",
                &times[..2],
                4,
                spline(turns([1.0, 0.0, 0.0])[..2].iter().map(|q| q.to_vec()).collect(), 0.4),
            ),
            keys(1, "scale", "CUBICSPLINE", &times, 3, spline(vectors(scales(4), 3), 0.5)),
        ],
        vec![
            keys(MESH_NODE, "weights", "CUBICSPLINE", &times, 3, spline(vectors(wave(12, 0.8), 3), 1.5)),
            keys(2, "rotation", "STEP", &times, 4, turns([0.3, 0.2, 1.0]).concat()),
            keys(1, "translation", "LINEAR", &times, 3, wave(12, 0.4)),
            keys(5, "translation", "CUBICSPLINE", &times, 3, spline(vectors(wave(12, 0.3), 3), 0.8)),
            keys(4, "scale", "LINEAR", &times, 3, scales(4)),
        ],
        vec![
            keys(MESH_NODE, "weights", "STEP", &times, 3, wave(12, -0.7)),
            keys(5, "rotation", "LINEAR", &times, 4, turns([1.0, 1.0, 0.0]).concat()),
            keys(2, "scale", "STEP", &times, 3, scales(4)),
        ],
    ]
}
