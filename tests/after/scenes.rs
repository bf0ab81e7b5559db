//! Whole scenes of glTF files, posed as `apply`, `render` and `view` do, against `formulas.rs`.

use super::formulas::{Drawn, File};
use crate::file::{F32, I8, I16, U8, U16, Written, bytes};
use crate::prelude::*;
use deltamorph::Result;
use deltamorph::import::gltf;
use deltamorph::import::gltf::{Animation, Channel, Gltf, Property};
use glam::{DVec3, Mat4, Quat, Vec3};
use serde_json::json;
use std::io::Write;
use std::path::{Path, PathBuf};

/// The largest error of a position, as a fraction of the diagonal of the scene at rest.
const ALLOWED: f64 = 5e-6;
/// The largest error of a normal, in degrees.
const TURNED: f64 = 0.01;

/// Weights by the names of targets.
type Weights = HashMap<String, f64>;

/// A mesh of a scene in float32 on the path `cpu`.
struct Posed {
    mesh: KeptMesh,
    crowd: CpuCrowd,
}

impl Posed {
    fn new(drawn: gltf::Drawn) -> Result<Self> {
        let mut mesh = drawn.source.kept(Tolerance::ZERO)?;
        mesh.recentre();
        let packed = Arc::new(PackedMesh::pack(&mesh, &PackDesc::new(DeltaFormat::Float32))?);
        let crowd = CpuCrowd::new(packed, &CrowdDesc::new(UpdateDesc::new(UpdatePath::Cpu, BatchSize::All)), 1)?;
        Ok(Self { mesh, crowd })
    }

    /// Returns positions and normals.
    fn vertices(&mut self, weights: &Weights) -> Vec<[DVec3; 2]> {
        let weight = |name: &String| weights.get(name).map_or(0.0, |weight| *weight as f32);
        let weights: Vec<f32> = self.mesh.targets.iter().map(|target| weight(&target.name)).collect();
        self.crowd.set_weights(0, &weights).expect("weights");
        self.crowd.update();
        let pose = self.crowd.layout().to_user_order(&self.crowd.pose(0).expect("a pose"));
        let pose: Vec<f64> = pose[..6 * self.mesh.vertex_count()].iter().map(|x| f64::from(*x)).collect();
        let origin = self.mesh.origin.as_dvec3();
        pose.chunks_exact(6).map(|v| [DVec3::from_slice(v) + origin, DVec3::from_slice(&v[3..])]).collect()
    }
}

/// A file beside its scene, with joints at rest.
struct Compared {
    gltf: Gltf,
    file: File,
    scene: Vec<Posed>,
    order: Vec<Drawn>,
    diagonal: f64,
    /// The largest angle between normals, in degrees.
    turned: f64,
}

impl Compared {
    fn new(path: &Path) -> Result<Self> {
        let gltf = gltf::read(path)?;
        let scene = gltf.clone().into_scene()?;
        let scene = std::iter::once(scene.mesh).chain(scene.still).map(Posed::new).collect::<Result<_>>()?;
        let file = File::read(path);
        let order = [file.drawn(true), file.drawn(false)].concat();
        let mut this = Self { gltf, file, scene, order, diagonal: 1.0, turned: 0.0 };
        let rest = this.expected(&|drawn| this.file.weights(drawn, None));
        let [low, high] = [DVec3::min, DVec3::max].map(|f| rest.iter().map(|v| v[0]).reduce(f).unwrap_or_default());
        this.diagonal = (high - low).length();
        Ok(this)
    }

    fn expected(&self, weights: &dyn Fn(Drawn) -> Vec<f64>) -> Vec<[DVec3; 2]> {
        let worlds = self.file.worlds(None);
        let vertices = |drawn: &Drawn| self.file.vertices(*drawn, &weights(*drawn), &worlds);
        self.order.iter().flat_map(vertices).collect()
    }

    fn names(&self, (_, node): Drawn) -> impl Iterator<Item = String> {
        self.gltf.target_names(node).map(str::to_owned)
    }

    /// The largest error with `weights`, of which `stated` replace what the file says; as a fraction of the diagonal.
    fn off(&mut self, stated: &Weights, weights: &dyn Fn(&Self, Drawn) -> Vec<f64>) -> f64 {
        let mut all = Weights::new();
        for drawn in self.order.clone() {
            for (name, weight) in self.names(drawn).zip(weights(self, drawn)) {
                let other = all.insert(name.clone(), weight);
                assert!(other.is_none_or(|other| other == weight), "{name} moves two nodes by one weight");
            }
        }
        all.extend(stated.iter().map(|(name, weight)| (name.clone(), *weight)));
        let expected = self.expected(&|drawn| weights(self, drawn));
        let found: Vec<[DVec3; 2]> = self.scene.iter_mut().flat_map(|posed| posed.vertices(&all)).collect();
        assert_eq!(found.len(), expected.len(), "the same vertices, once for each node that draws them");
        let worst = found.iter().zip(&expected).map(|(a, b)| a[0].distance(b[0])).fold(0.0, f64::max);
        let stated = found.iter().zip(&expected).filter(|(_, [_, normal])| *normal != DVec3::ZERO);
        let angles = stated.map(|(a, b)| reference::angle_degrees(a[1], b[1]));
        self.turned = angles.fold(self.turned, f64::max);
        worst / self.diagonal
    }

    /// At rest, with three sets of random weights, and at three times of each clip.
    fn errors(&mut self) -> [f64; 3] {
        let file = |this: &Self, drawn: Drawn| this.file.weights(drawn, None);
        let rest = self.off(&Weights::new(), &file);
        let random = |salt: u32| {
            move |this: &Self, drawn: Drawn| -> Vec<f64> {
                let hash =
                    |name: &String| name.bytes().fold(salt, |hash, b| (hash ^ u32::from(b)).wrapping_mul(16777619));
                this.names(drawn).map(|name| f64::from(hash(&name) >> 8) / f64::from(1 << 24)).collect()
            }
        };
        let weights = [1, 2, 3].map(|salt| self.off(&Weights::new(), &random(salt)));
        let mut clips = 0.0f64;
        for clip in 0..self.gltf.animations.len() {
            let animation = &self.gltf.animations[clip];
            let Ok(frames) = self.gltf.clip(animation, None) else { continue };
            let times = frame_times(animation, &frames);
            for frame in [1, 3, 5].map(|sixth| times.len() * sixth / 6) {
                let values = frames.names.iter().zip(&frames.values[frame * frames.names.len()..]);
                let stated = values.map(|(name, weight)| (name.clone(), f64::from(*weight))).collect();
                let playing = Some((clip, times[frame]));
                let file = |this: &Self, drawn: Drawn| this.file.weights(drawn, playing);
                clips = clips.max(self.off(&stated, &file));
            }
        }
        [rest, weights.into_iter().fold(0.0, f64::max), clips]
    }
}

/// The time of each frame of a clip, or that of a key next to it: steps happen in the frame that they belong to.
fn frame_times(animation: &Animation, clip: &WeightClip) -> Vec<f64> {
    let weights = animation.channels.iter().filter(|channel| channel.property == Property::Weights);
    let [start, end] =
        weights.clone().map(Channel::span).reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]).unwrap_or_default();
    let keys: Vec<f64> = weights.flat_map(|channel| &channel.times).copied().map(f64::from).collect();
    let frame = 1.0 / f64::from(clip.fps);
    let near = |time: f64| keys.iter().copied().find(|key| (key - time).abs() <= 1e-3 * frame).unwrap_or(time);
    (0..clip.frame_count()).map(|i| near((start + i as f64 * frame).min(end))).collect()
}

/// Prints a row for each file, and returns those that are further off than allowed.
fn table(files: &[(String, PathBuf)]) -> Vec<String> {
    println!("| file | vertices | targets | at rest | weights | clips |\n|---|---|---|---|---|---|");
    let mut wrong = vec![];
    for (name, path) in files {
        let mut compared = match Compared::new(path) {
            Ok(compared) => compared,
            Err(e) => {
                let text = e.to_string().replace(&path.display().to_string(), "").replace('|', "/");
                println!("| {name} | not read{text} |");
                continue;
            }
        };
        let [rest, weights, clips] = compared.errors();
        // Also false of what is not a number.
        if !(rest <= ALLOWED && weights <= ALLOWED && clips <= ALLOWED) {
            wrong.push(name.clone());
        }
        let count = |of: fn(&KeptMesh) -> usize| compared.scene.iter().map(|posed| of(&posed.mesh)).sum::<usize>();
        let (vertices, targets) = (count(KeptMesh::vertex_count), count(|mesh| mesh.targets.len()));
        println!("| {name} | {vertices} | {targets} | {rest:.1e} | {weights:.1e} | {clips:.1e} |");
    }
    wrong
}

/// All glTF files below a folder, by their paths in it.
fn below(folder: &Path, root: &Path, found: &mut Vec<(String, PathBuf)>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            below(&path, root, found);
        } else if deltamorph::import::is_gltf(&path) {
            found.push((path.strip_prefix(root).unwrap().display().to_string(), path));
        }
    }
    found.sort();
}

/// Stores the elements of an accessor, of `N` bytes each, as this extension has them, in this version of its format.
fn compress<const N: usize>(file: &mut Written, accessor: usize, extension: &str, version: i32)
where
    [u8; N]: bytemuck::Pod,
{
    let view = file.json["accessors"][accessor]["bufferView"].as_u64().unwrap() as usize;
    let [first, size] = ["byteOffset", "byteLength"].map(|key| file.json["bufferViews"][view][key].as_u64().unwrap());
    let plain = &file.bytes[first as usize..][..size as usize];
    let data = ::meshopt::encode_vertex_buffer_level(plain.as_chunks::<N>().0, 3, Some(version)).unwrap();
    file.view(&data);
    let mut packed = file.json["bufferViews"].as_array_mut().unwrap().pop().unwrap();
    (packed["mode"], packed["count"]) = (json!("ATTRIBUTES"), json!(size as usize / N));
    packed["byteStride"] = json!(N);
    file.json["bufferViews"][view] = json!({"buffer": 1, "byteLength": size, "extensions": {extension: packed}});
    file.json["buffers"][1] = json!({"byteLength": 1 << 24});
}

/// Two skins of one skeleton, the second of a quantised mesh; a mesh that three nodes draw, mirrored and stretched,
/// with targets without names; a still mesh on a joint. Targets are dense, sparse and integers, normals floats and
/// bytes, influences four and eight; two views are compressed; clips are splines, steps, lines and a pointer.
fn several() -> Written {
    let mut file = Written::default();
    file.json["buffers"].as_array_mut().unwrap().push(json!({"byteLength": 0}));
    let point = |v: usize, k: f32| [0.0, 1.7, 3.4].map(|c| (v as f32 * 1.3 + c + k).sin());
    let points = |n: usize, k: f32| (0..n).map(|v| point(v, k)).collect::<Vec<[f32; 3]>>();
    let directions =
        |k: f32| points(6, k).into_iter().map(|p| Vec3::from(p).normalize().to_array()).collect::<Vec<_>>();
    let corners = file.accessor(U16, "SCALAR", 12, &bytes(&[0u16, 1, 2, 1, 3, 2, 2, 3, 4, 4, 3, 5]));
    let [face, button, hat] = [0.0, 1.0, 2.0].map(|k| file.floats(&points(6, k)));
    let [jaw, first, second] = [3.0, 4.0, 5.0].map(|k| file.floats(&points(6, k)));
    compress::<12>(&mut file, button, "EXT_meshopt_compression", 0);
    let [normals, turned] = [9.0, 10.0].map(|k| file.floats(&directions(k)));
    let lean = file.floats(&[[0.1, 0.2, -0.3]; 6]);
    let (places, deltas) = (file.view(&bytes(&[1u16, 4])), file.view(&bytes(points(2, 6.0).as_flattened())));
    let sparse = json!({"componentType": F32, "type": "VEC3", "count": 6, "sparse": {"count": 2,
        "indices": {"bufferView": places, "componentType": U16}, "values": {"bufferView": deltas}}});
    file.json["accessors"].as_array_mut().unwrap().push(sparse);
    let brow = file.json["accessors"].as_array().unwrap().len() - 1;
    // Integers, with padding after the third.
    let mut padded = |component: u32, numbers: Vec<u8>| {
        let accessor = file.accessor(component, "VEC3", 6, &numbers);
        let view = file.json["accessors"][accessor]["bufferView"].as_u64().unwrap() as usize;
        file.json["bufferViews"][view]["byteStride"] = json!(numbers.len() / 6);
        file.json["accessors"][accessor]["normalized"] = json!(component == I8);
        accessor
    };
    let four = |p: &[f32; 3], by: f32| [p[0], p[1], p[2], 0.0].map(|x| (x * by) as i16);
    let [teeth, pulled] = [7.0, 3.0].map(|k| {
        let shorts: Vec<i16> = points(6, k).iter().flat_map(|p| four(p, 9000.0)).collect();
        padded(I16, bytes(&shorts))
    });
    let [of_teeth, of_pulled] = [2.0, 5.0].map(|k| {
        let chars: Vec<i8> = directions(k).iter().flat_map(|p| four(p, 127.0 / (k - 1.0)).map(|x| x as i8)).collect();
        padded(I8, bytes(&chars))
    });
    let joints = file.accessor(U16, "VEC4", 6, &bytes([[0u16, 1, 0, 0]; 6].as_flattened()));
    let shares: Vec<[f32; 4]> = (0..6).map(|v| [1.0 - v as f32 / 5.0, v as f32 / 5.0, 0.0, 0.0]).collect();
    let shares = file.floats(&shares);
    let bytes_of_shares: Vec<u8> = (0..6u8).flat_map(|v| [255 - 51 * v, 51 * v, 0, 0]).collect();
    let short = file.accessor(U8, "VEC4", 6, &bytes_of_shares);
    file.json["accessors"][short]["normalized"] = json!(true);
    // Two more of each vertex, as if of one weight in all.
    let more = file.accessor(U8, "VEC4", 6, &[2, 0, 1, 2].repeat(6));
    let fewer = file.floats(&(0..6).map(|v| [0.1 * v as f32, 0.3, 0.0, 0.2]).collect::<Vec<_>>());
    let turn = Mat4::from_rotation_x(0.4) * Mat4::from_translation(Vec3::new(-1.0, 0.5, 0.0));
    let small = turn * Mat4::from_scale(Vec3::splat(1.0 / 9000.0));
    let tilt = Mat4::from_rotation_z(0.2);
    let [bind, other] = [[Mat4::IDENTITY, turn, tilt], [small, tilt * small, turn * small]]
        .map(|m| file.floats(&m.map(|m| m.to_cols_array())));
    let mesh = |attributes: serde_json::Value, targets: &[usize], names: &[&str]| {
        let targets: Vec<_> = targets.iter().map(|target| json!({"POSITION": target})).collect();
        json!({"primitives": [{"attributes": attributes, "indices": corners, "targets": targets}],
            "extras": {"targetNames": names}})
    };
    file.json["meshes"] = json!([
        mesh(
            json!({"POSITION": face, "NORMAL": normals, "JOINTS_0": joints, "WEIGHTS_0": shares,
            "JOINTS_1": more, "WEIGHTS_1": fewer}),
            &[jaw, brow],
            &["jaw", "brow"]
        ),
        mesh(
            json!({"POSITION": teeth, "NORMAL": of_teeth, "JOINTS_0": joints, "WEIGHTS_0": short}),
            &[pulled],
            &["teeth"]
        ),
        mesh(json!({"POSITION": button, "NORMAL": normals}), &[first, second], &[]),
        mesh(json!({"POSITION": hat, "NORMAL": normals}), &[], &[])
    ]);
    for (mesh, target, turned) in [(0, 0, turned), (0, 1, lean), (1, 0, of_pulled), (2, 0, lean), (2, 1, turned)] {
        file.json["meshes"][mesh]["primitives"][0]["targets"][target]["NORMAL"] = json!(turned);
    }
    file.json["skins"] = json!([{"joints": [1, 2, 8], "inverseBindMatrices": bind},
        {"joints": [2, 1, 8], "inverseBindMatrices": other}]);
    let by = |q: Quat| json!(q.to_array());
    let askew = Mat4::from_axis_angle(Vec3::ONE.normalize(), 2.0).to_cols_array();
    file.json["nodes"] = json!([
        {"mesh": 0, "skin": 0, "translation": [5, 5, 5]},
        {"translation": [0, 1, 0], "rotation": by(Quat::from_rotation_y(0.5)), "children": [2, 8]},
        {"translation": [0.5, 0, 0.25], "scale": [1, 1.5, 0.75], "children": [6, 7]},
        {"mesh": 1, "skin": 1},
        {"mesh": 2, "translation": [2, 0, 0], "scale": [-1, 2, 0.5], "rotation": by(Quat::from_rotation_z(1.0))},
        {"mesh": 2, "matrix": askew},
        {"mesh": 2, "translation": [0, 0, 3]},
        {"mesh": 3, "scale": [0.5, 0.5, 0.5]},
        {"matrix": askew}]);
    let times = file.floats(&[[0.0], [0.4], [1.1]]);
    let spline = file.floats([0.1, 0.3, -0.2, 0.9, 0.6, 0.4, -0.5, 0.2, 0.8].map(|x| [[x], [x * 0.5]]).as_flattened());
    let turns = [0.1, 2.9, -1.0].map(|a| Quat::from_rotation_x(a).to_array());
    let turns = file.floats(&turns);
    compress::<16>(&mut file, turns, "KHR_meshopt_compression", 1);
    let steps = file.floats(&[[0.0], [1.0], [0.5], [0.25], [1.0], [0.0]]);
    let moves = file.floats(&points(9, 8.0));
    let bends = [0.3, 0.1, 0.2, -0.4, 0.9, 0.5, 0.2, 1.4, -0.3].map(|a| Quat::from_rotation_z(a).to_array());
    let (bends, jumps) = (file.floats(&bends), file.floats(&points(3, 9.0)));
    let sizes = file.floats(&points(3, 2.0).iter().map(|p| p.map(|x| 1.5 + 0.5 * x)).collect::<Vec<_>>());
    let pointer = json!({"path": "pointer",
        "extensions": {"KHR_animation_pointer": {"pointer": "/meshes/2/weights"}}});
    file.json["animations"] = json!([{
        "channels": [
            {"sampler": 0, "target": {"node": 0, "path": "weights"}},
            {"sampler": 1, "target": {"node": 2, "path": "rotation"}},
            {"sampler": 2, "target": pointer},
            {"sampler": 3, "target": {"node": 1, "path": "translation"}},
            {"sampler": 4, "target": {"node": 1, "path": "rotation"}},
            {"sampler": 5, "target": {"node": 2, "path": "translation"}},
            {"sampler": 6, "target": {"node": 2, "path": "scale"}}],
        "samplers": [
            {"input": times, "output": spline, "interpolation": "CUBICSPLINE"},
            {"input": times, "output": turns},
            {"input": times, "output": steps, "interpolation": "STEP"},
            {"input": times, "output": moves, "interpolation": "CUBICSPLINE"},
            {"input": times, "output": bends, "interpolation": "CUBICSPLINE"},
            {"input": times, "output": jumps, "interpolation": "STEP"},
            {"input": times, "output": sizes}]}]);
    file
}

#[test]
fn what_a_file_draws_stands_as_gltf_says() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("several.glb");
    std::fs::write(&path, several().glb()).unwrap();
    let wrong = table(&[("several".to_owned(), path.clone())]);
    assert!(wrong.is_empty(), "{wrong:?}");
    let mut compared = Compared::new(&path).unwrap();
    compared.errors();
    println!("normals are off by {:.1e} degrees", compared.turned);
    assert!(compared.turned > 0.0 && compared.turned < TURNED, "{} degrees", compared.turned);
}

/// `DELTAMORPH_DATA` may name any folder.
#[test]
fn files_in_the_folder_of_the_data_sets_stand_as_gltf_says() {
    let Some(folder) = std::env::var_os("DELTAMORPH_DATA").map(PathBuf::from) else {
        std::io::stderr().write_all(b"LEFT OUT: DELTAMORPH_DATA names no folder of glTF files\n").unwrap();
        return;
    };
    let mut files = vec![];
    below(&folder, &folder, &mut files);
    let wrong = table(&files);
    assert!(wrong.is_empty(), "{wrong:?}");
}
