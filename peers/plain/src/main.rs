//! What a loop of one's own takes: float32 deltas, dense or sparse, all of them or those that changed; and deltamorph's
//! CPU path beside it. Prints a line of JSON for each way and work, with the error against a sum in float64.
//!
//!     cargo run --release -- FILE.glb [SECONDS]

use deltamorph::glam::Vec3;
use deltamorph::import::{self, ImportedMesh};
use deltamorph::{
    BatchSize, CpuCrowd, CrowdDesc, DeltaFormat, KeptMesh, PackDesc, PackedMesh, PoseFormat, Tolerance, UpdateDesc,
    UpdatePath,
};
use rayon::prelude::*;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

type Result<T, E = Box<dyn std::error::Error>> = std::result::Result<T, E>;
/// Floats of a vertex: position, normal, and nothing up to a width that suits the CPU.
const DENSE: usize = 6;
const SPARSE: usize = 8;

/// Vertices whose sum stays in the first cache.
const CHUNK: usize = 512;

/// A target: a delta for each vertex, or for some.
enum Deltas<const N: usize> {
    Dense(Vec<[f32; N]>),
    /// Vertices and their deltas, and where each chunk of the mesh begins in them.
    Sparse(Vec<u32>, Vec<[f32; N]>, Vec<usize>),
}

/// A pose that is summed up anew, or by what changed.
struct Plain<const N: usize> {
    base: Vec<[f32; N]>,
    targets: Vec<Deltas<N>>,
    pose: Vec<[f32; N]>,
    weights: Vec<f32>,
    incremental: bool,
}

impl<const N: usize> Plain<N> {
    fn new(mesh: &KeptMesh, incremental: bool) -> Self {
        let zip = |p: &[_], n: &[_]| -> Vec<[f32; N]> { p.iter().zip(n).map(|(p, n)| vertex(*p, *n)).collect() };
        let base = zip(&mesh.positions, &mesh.normals);
        let targets = mesh.targets.iter().map(|target| {
            let deltas = zip(&target.positions, &target.normals);
            if N == DENSE {
                let mut all = vec![[0.0; N]; base.len()];
                target.vertices.iter().zip(deltas).for_each(|(v, delta)| all[*v as usize] = delta);
                return Deltas::Dense(all);
            }
            let chunks = 0..=base.len().div_ceil(CHUNK);
            let begins = chunks.map(|c| target.vertices.partition_point(|v| (*v as usize) < c * CHUNK)).collect();
            Deltas::Sparse(target.vertices.clone(), deltas, begins)
        });
        let targets: Vec<Deltas<N>> = targets.collect();
        Self { weights: vec![0.0; targets.len()], pose: base.clone(), base, targets, incremental }
    }

    fn update(&mut self, row: &[f32]) {
        let old = |k: usize| if self.incremental { self.weights[k] } else { 0.0 };
        let terms = row.iter().enumerate().map(|(k, weight)| (&self.targets[k], weight - old(k)));
        let terms: Vec<_> = terms.filter(|(_, weight)| *weight != 0.0).collect();
        let base = (!self.incremental).then_some(&self.base);
        if base.is_some() || !terms.is_empty() {
            self.pose.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, pose)| sum(base, chunk, pose, &terms));
        }
        self.weights.copy_from_slice(row);
    }
}

fn sum<const N: usize>(base: Option<&Vec<[f32; N]>>, chunk: usize, pose: &mut [[f32; N]], terms: &[(&Deltas<N>, f32)]) {
    let first = chunk * CHUNK;
    if let Some(base) = base {
        pose.copy_from_slice(&base[first..first + pose.len()]);
    }
    let len = pose.len();
    for four in terms.chunks(4) {
        if let [(Deltas::Dense(a), wa), (Deltas::Dense(b), wb), (Deltas::Dense(c), wc), (Deltas::Dense(d), wd)] = four {
            // Four targets at a time: the pose is loaded and stored a quarter as often.
            let [a, b, c, d] = [a, b, c, d].map(|all| all[first..first + len].as_flattened());
            for (i, x) in pose.as_flattened_mut().iter_mut().enumerate() {
                *x = d[i].mul_add(*wd, c[i].mul_add(*wc, b[i].mul_add(*wb, a[i].mul_add(*wa, *x))));
            }
            continue;
        }
        for (deltas, weight) in four {
            match deltas {
                Deltas::Dense(all) => pose.iter_mut().zip(&all[first..]).for_each(|(x, d)| add(x, d, *weight)),
                Deltas::Sparse(vertices, deltas, begins) => {
                    let here = begins[chunk]..begins[chunk + 1];
                    let moved = vertices[here.clone()].iter().zip(&deltas[here]);
                    moved.for_each(|(v, d)| add(&mut pose[*v as usize - first], d, *weight));
                }
            }
        }
    }
}

fn add<const N: usize>(x: &mut [f32; N], delta: &[f32; N], weight: f32) {
    x.iter_mut().zip(delta).for_each(|(x, d)| *x = d.mul_add(weight, *x));
}

fn vertex<const N: usize>(position: Vec3, normal: Vec3) -> [f32; N] {
    let mut all = [0.0; N];
    all[..3].copy_from_slice(&position.to_array());
    all[3..6].copy_from_slice(&normal.to_array());
    all
}

/// Returns the largest difference of positions from sums in float64, as a fraction of the diagonal.
fn error<const N: usize>(mesh: &KeptMesh, row: &[f32], pose: &[[f32; N]]) -> f64 {
    let mut sums: Vec<_> = mesh.positions.iter().map(|p| p.as_dvec3()).collect();
    for (target, weight) in mesh.targets.iter().zip(row) {
        let moved = target.vertices.iter().zip(&target.positions);
        moved.for_each(|(v, d)| sums[*v as usize] += f64::from(*weight) * d.as_dvec3());
    }
    let off = sums.iter().zip(pose).map(|(sum, x)| {
        let difference = sum.to_array().into_iter().zip(x).map(|(sum, x)| (sum - f64::from(*x)).abs());
        difference.fold(0.0, f64::max)
    });
    off.fold(0.0, f64::max) / f64::from(mesh.diagonal)
}

/// Plays rows over and over; returns the median of milliseconds, and the number of the last row.
fn time(rows: usize, limit: Duration, mut update: impl FnMut(usize)) -> (f64, usize) {
    update(0);
    let (begin, mut times) = (Instant::now(), vec![]);
    while times.len() < 5 || (begin.elapsed() < limit && times.len() < 2_000) {
        let row = (times.len() + 1) % rows;
        let frame = Instant::now();
        update(row);
        times.push(1e3 * frame.elapsed().as_secs_f64());
    }
    let last = times.len() % rows;
    times.sort_by(f64::total_cmp);
    (times[times.len() / 2], last)
}

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("FILE.glb [SECONDS]")?;
    let limit = Duration::from_secs_f64(arguments.next().map_or(Ok(0.5), |seconds| seconds.parse())?);
    let ImportedMesh::Source(source) = import::open(Path::new(&path))?.mesh else {
        return Err("a packed file has no float32 deltas".into());
    };
    let mesh = source.kept(Tolerance::default())?;
    let names: Vec<&str> = mesh.targets.iter().map(|target| target.name.as_str()).collect();
    let scene = Path::new(&path).file_stem().unwrap_or_default().to_string_lossy();
    let packed = Arc::new(PackedMesh::pack(&mesh, &PackDesc::new(DeltaFormat::Fast))?);
    let threads = rayon::current_num_threads();
    for work in ["clip", "all", "constant"] {
        let clip = import::open_clip(Path::new(&format!("{path}#{work}")), None)?;
        let rows: Vec<Vec<f32>> = clip.bind(&names)?.frames().collect();
        let print = |peer: &str, ms: f64, off: f64| {
            let what = format!(r#""peer":"{peer}","device":"{threads} threads","scene":"{scene}","work":"{work}""#);
            println!(r#"{{{what},"ms":{ms:.4},"without":0,"check":{{"off":{off:.1e},"right":{}}}}}"#, off < 1e-4);
        };
        for (way, incremental) in [("rebuilt", false), ("incremental", true)] {
            let mut dense = Plain::<DENSE>::new(&mesh, incremental);
            let (ms, last) = time(rows.len(), limit, |row| dense.update(&rows[row]));
            print(&format!("plain Rust, dense, {way}"), ms, error(&mesh, &rows[last], &dense.pose));
            let mut sparse = Plain::<SPARSE>::new(&mesh, incremental);
            let (ms, last) = time(rows.len(), limit, |row| sparse.update(&rows[row]));
            print(&format!("plain Rust, sparse, {way}"), ms, error(&mesh, &rows[last], &sparse.pose));
        }
        let mut best: Option<(f64, f64)> = None;
        for format in [PoseFormat::Float32, PoseFormat::Fixed32] {
            let desc = UpdateDesc { pose: format, ..UpdateDesc::new(UpdatePath::Cpu, BatchSize::All) };
            // Refused where float32 sums of so many targets may drift too far.
            let Ok(mut crowd) = CpuCrowd::new(packed.clone(), &CrowdDesc::new(desc), threads) else { continue };
            let (ms, last) = time(rows.len(), limit, |row| {
                crowd.set_weights(0, &rows[row]).expect("weights of the clip");
                crowd.update();
            });
            let pose = packed.layout().to_user_order(&crowd.pose(0)?);
            let off = error::<DENSE>(&mesh, &rows[last], pose.as_chunks().0);
            best = best.filter(|best| best.0 < ms).or(Some((ms, off)));
        }
        let (ms, off) = best.ok_or("no pose format suits the mesh")?;
        print("deltamorph, cpu", ms, off);
    }
    Ok(())
}
