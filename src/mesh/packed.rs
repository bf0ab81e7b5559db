//! Deltas laid out for the update paths: dense, target after target, in words of 32 bits.
//!
//! ```text
//! base    [vertex][px py pz nx ny nz]                      24 bytes a vertex (the layout of a pose, too)
//! deltas  [chunk][target][vertex in chunk][words]          24 bytes (float32) or 12 bytes (snorm16)
//! ```
//!
//! Vertices are padded with zeros to a multiple of [`VERTEX_PADDING`], so that no kernel needs a bounds check.
//! A mesh has one chunk unless its deltas exceed the storage-buffer range of the device, or its vertices the
//! workgroups of a dispatch ([`PackDesc`]); then its vertices are cut into chunks that fit.

use super::{MorphMesh, MorphTarget};
use crate::error::{Error, Result};
use glam::Vec3;

/// Vertices are padded to a multiple of this: the workgroup size of every dense kernel, an even number (the
/// feedback passes draw lines), and a multiple of every device's buffer-offset alignment (64 × 12 bytes).
pub const VERTEX_PADDING: usize = 64;

/// Floats of one vertex of a pose: position, then normal.
pub const POSE_FLOATS: usize = 6;

/// Bytes of one vertex of a pose.
pub const POSE_STRIDE: usize = POSE_FLOATS * 4;

/// How one delta (position and normal) is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DeltaFormat {
    /// Six float32: 24 bytes, two vertex attributes a target. Exact.
    Float32,
    /// Six signed 16-bit integers in three words: 12 bytes, one vertex attribute a target. Value = integer ×
    /// step, a step for positions per target, and a power of two times that step for normals.
    Snorm16,
}

impl DeltaFormat {
    /// Every format.
    pub const ALL: [Self; 2] = [Self::Float32, Self::Snorm16];

    /// 32-bit words of one delta.
    pub const fn words(self) -> usize {
        match self {
            Self::Float32 => 6,
            Self::Snorm16 => 3,
        }
    }

    /// Bytes of one delta.
    pub const fn stride(self) -> usize {
        self.words() * 4
    }

    /// Vertex attributes that one target takes in a feedback pass.
    pub const fn attributes(self) -> usize {
        match self {
            Self::Float32 => 2,
            Self::Snorm16 => 1,
        }
    }

    /// The name used on the command line and in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Float32 => "float32",
            Self::Snorm16 => "snorm16",
        }
    }
}

/// How to pack.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PackDesc {
    /// Storage of a delta.
    pub format: DeltaFormat,
    /// Most bytes of deltas that one descriptor may cover: the device's `maxStorageBufferRange`.
    pub max_chunk_bytes: u64,
    /// Most vertices of a chunk: the device's workgroups per dispatch × [`VERTEX_PADDING`].
    pub max_chunk_vertices: u64,
}

impl Default for PackDesc {
    /// float32, in chunks of 128 MiB and 65,535 workgroups (the least that Khronos' Android profiles promise).
    fn default() -> Self {
        Self {
            format: DeltaFormat::Float32,
            max_chunk_bytes: 128 << 20,
            max_chunk_vertices: 65_535 * VERTEX_PADDING as u64,
        }
    }
}

/// A target of a [`PackedMesh`].
#[derive(Clone, Debug, PartialEq)]
pub struct PackedTarget {
    /// Its name.
    pub name: String,
    /// Length units per integer step of a position delta; 1 for float32.
    pub position_step: f32,
    /// The step of normals is `position_step × 2^normal_exponent`; 0 for float32.
    pub normal_exponent: i8,
}

impl PackedTarget {
    /// Factor from the coefficient of positions to that of normals: `2^normal_exponent`.
    pub fn normal_ratio(&self) -> f32 {
        f32::from_bits(((i32::from(self.normal_exponent) + 127) as u32) << 23)
    }

    /// Normal units per integer step of a normal delta.
    pub fn normal_step(&self) -> f32 {
        self.position_step * self.normal_ratio()
    }
}

/// Where everything is in a [`PackedMesh`]; what the GPU side keeps of it after upload.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedLayout {
    /// Name of the mesh.
    pub name: String,
    /// Storage of a delta.
    pub format: DeltaFormat,
    /// Number of vertices, without padding.
    pub vertex_count: usize,
    /// Vertices of every chunk but the last, which has the rest. A multiple of [`VERTEX_PADDING`].
    pub chunk_vertices: usize,
    /// Length of the base pose's bounding-box diagonal, in input units.
    pub diagonal: f32,
    /// The targets.
    pub targets: Vec<PackedTarget>,
}

impl PackedLayout {
    /// Number of vertices with padding: a multiple of [`VERTEX_PADDING`].
    pub fn padded_vertices(&self) -> usize {
        self.vertex_count.next_multiple_of(VERTEX_PADDING)
    }

    /// The chunks: `(first vertex, vertices)`.
    pub fn chunks(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let (all, step) = (self.padded_vertices(), self.chunk_vertices.max(1));
        (0..all).step_by(step).map(move |first| (first, step.min(all - first)))
    }

    /// Bytes of one pose, padding included.
    pub fn pose_bytes(&self) -> u64 {
        (self.padded_vertices() * POSE_STRIDE) as u64
    }

    /// Bytes of all deltas, padding included.
    pub fn delta_bytes(&self) -> u64 {
        (self.padded_vertices() * self.targets.len() * self.format.stride()) as u64
    }

    /// Index of the first word of the deltas of target `target` in the chunk that starts at vertex `first` and
    /// has `vertices`.
    pub fn row_start(&self, target: usize, first: usize, vertices: usize) -> usize {
        (first * self.targets.len() + target * vertices) * self.format.words()
    }

    /// Index of the first word of the delta of `vertex` in target `target`.
    fn word_index(&self, target: usize, vertex: usize) -> usize {
        let within = vertex % self.chunk_vertices;
        let first = vertex - within;
        let rows = self.chunk_vertices.min(self.padded_vertices() - first);
        self.row_start(target, first, rows) + within * self.format.words()
    }
}

/// A mesh laid out for upload. See the [module](self) for the layout.
#[derive(Clone, Debug)]
pub struct PackedMesh {
    layout: PackedLayout,
    base: Vec<f32>,
    deltas: Vec<u32>,
}

/// Targets are named by 16 bits in the kernels.
const TARGETS_MAX: usize = 1 << 16;

const SNORM16_MAX: f32 = 32767.0;

/// The steps of one snorm16 target: the smallest that let its largest component fit.
fn snorm16_steps(target: &MorphTarget) -> (f32, i8) {
    let largest = |deltas: &[Vec3]| deltas.iter().map(|d| d.abs().max_element()).fold(0.0, f32::max);
    let (position, normal) = (largest(&target.positions), largest(&target.normals));
    // A target that only turns normals still needs a step of its own for positions.
    let position = if position > 0.0 { position } else { normal };
    // Not below what a float32 coefficient can carry: a target smaller than that is no target.
    let step = (position / SNORM16_MAX).max(1e-30);
    if normal == 0.0 {
        return (step, 0);
    }
    let exponent = (normal / (SNORM16_MAX * step)).log2().ceil().clamp(-100.0, 100.0);
    (step, exponent as i8)
}

/// Round to the nearest step; zero stays zero.
fn quantise(value: f32, step: f32) -> u32 {
    let q = (f64::from(value) / f64::from(step)).round().clamp(-32767.0, 32767.0) as i16;
    u32::from(q as u16)
}

impl PackedMesh {
    /// Lay out `mesh`.
    ///
    /// # Errors
    /// More than 65,536 targets, or more than fit `desc.max_chunk_bytes` even for [`VERTEX_PADDING`] vertices.
    pub fn pack(mesh: &MorphMesh, desc: &PackDesc) -> Result<Self> {
        let vertex_count = mesh.vertex_count();
        let padded = vertex_count.next_multiple_of(VERTEX_PADDING);
        let target_count = mesh.targets.len();
        let words = desc.format.words();
        if target_count > TARGETS_MAX {
            return Err(Error::invalid(
                format!("mesh '{}' has {target_count} targets; the kernels name at most {TARGETS_MAX}", mesh.name),
                "split the targets over several meshes",
            ));
        }
        let per_padding = target_count * VERTEX_PADDING * desc.format.stride();
        if per_padding as u64 > desc.max_chunk_bytes {
            return Err(Error::invalid(
                format!(
                    "mesh '{}': {target_count} targets need {per_padding} bytes of deltas for {VERTEX_PADDING} vertices, \
                     but the device binds at most {} bytes at once",
                    mesh.name, desc.max_chunk_bytes
                ),
                "use fewer targets or the snorm16 format",
            ));
        }
        // Whole workgroups, at least one.
        let groups = desc.max_chunk_bytes.checked_div(per_padding as u64).unwrap_or(u64::MAX);
        let groups = groups.min(desc.max_chunk_vertices / VERTEX_PADDING as u64).max(1);
        let chunk_vertices = groups.saturating_mul(VERTEX_PADDING as u64).min(padded as u64) as usize;

        let mut base = vec![0.0; padded * POSE_FLOATS];
        for (vertex, (p, n)) in base.chunks_exact_mut(POSE_FLOATS).zip(mesh.positions.iter().zip(&mesh.normals)) {
            vertex[..3].copy_from_slice(&p.to_array());
            vertex[3..].copy_from_slice(&n.to_array());
        }

        let describe = |target: &MorphTarget| {
            let (position_step, normal_exponent) = match desc.format {
                DeltaFormat::Float32 => (1.0, 0),
                DeltaFormat::Snorm16 => snorm16_steps(target),
            };
            PackedTarget { name: target.name.clone(), position_step, normal_exponent }
        };
        let layout = PackedLayout {
            name: mesh.name.clone(),
            format: desc.format,
            vertex_count,
            chunk_vertices,
            diagonal: mesh.diagonal,
            targets: mesh.targets.iter().map(describe).collect(),
        };
        let mut deltas = vec![0; padded * target_count * words];
        for (t, target) in mesh.targets.iter().enumerate() {
            pack_target(&layout, t, target, &mut deltas);
        }
        Ok(Self { layout, base, deltas })
    }

    /// The delta that the kernels see, decoded in double precision: position, then normal.
    ///
    /// # Panics
    /// When `target` or `vertex` is out of range.
    pub fn delta(&self, target: usize, vertex: usize) -> [f64; POSE_FLOATS] {
        let at = self.layout.word_index(target, vertex);
        let words = &self.deltas[at..at + self.layout.format.words()];
        match self.layout.format {
            DeltaFormat::Float32 => std::array::from_fn(|i| f64::from(f32::from_bits(words[i]))),
            DeltaFormat::Snorm16 => {
                let info = &self.layout.targets[target];
                let steps = [f64::from(info.position_step), f64::from(info.normal_step())];
                std::array::from_fn(|i| f64::from((words[i / 2] >> (16 * (i % 2))) as u16 as i16) * steps[i / 3])
            }
        }
    }

    /// The words of target `target` for `vertices` vertices from `first` on, all of one chunk.
    pub(crate) fn rows(&self, target: usize, first: usize, vertices: usize) -> &[u32] {
        let at = self.layout.word_index(target, first);
        &self.deltas[at..at + vertices * self.layout.format.words()]
    }

    /// Where everything is.
    pub fn layout(&self) -> &PackedLayout {
        &self.layout
    }

    /// Base pose: [`POSE_FLOATS`] floats for each padded vertex.
    pub fn base(&self) -> &[f32] {
        &self.base
    }

    /// The deltas as words; see the [module](self) for the layout.
    pub fn deltas(&self) -> &[u32] {
        &self.deltas
    }
}

/// Write the deltas of target `t` where `layout` wants them.
fn pack_target(layout: &PackedLayout, t: usize, target: &MorphTarget, deltas: &mut [u32]) {
    let info = &layout.targets[t];
    let normal_step = info.normal_step();
    for ((&vertex, p), n) in target.vertices.iter().zip(&target.positions).zip(&target.normals) {
        let at = layout.word_index(t, vertex as usize);
        let out = &mut deltas[at..at + layout.format.words()];
        match layout.format {
            DeltaFormat::Float32 => {
                for (word, value) in out.iter_mut().zip(p.to_array().into_iter().chain(n.to_array())) {
                    *word = value.to_bits();
                }
            }
            DeltaFormat::Snorm16 => {
                let [px, py, pz] = p.to_array().map(|v| quantise(v, info.position_step));
                let [nx, ny, nz] = n.to_array().map(|v| quantise(v, normal_step));
                out.copy_from_slice(&[px | py << 16, pz | nx << 16, ny | nz << 16]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Faces, Tolerance};

    fn mesh(vertices: usize, targets: usize) -> MorphMesh {
        let value = |i: usize| ((i * 2_654_435_761 % 1000) as f32 / 500.0) - 1.0;
        let vec = |i: usize| Vec3::new(value(3 * i), value(3 * i + 1), value(3 * i + 2));
        MorphMesh {
            name: "m".into(),
            positions: (0..vertices).map(vec).collect(),
            normals: vec![Vec3::Z; vertices],
            texcoords: vec![],
            faces: Faces::default(),
            targets: (0..targets)
                .map(|t| MorphTarget {
                    name: format!("t{t}"),
                    vertices: (0..vertices as u32).filter(|v| !(*v as usize + t).is_multiple_of(3)).collect(),
                    positions: (0..vertices)
                        .filter(|v| !(v + t).is_multiple_of(3))
                        .map(|v| vec(v + t) * 0.01)
                        .collect(),
                    normals: (0..vertices).filter(|v| !(v + t).is_multiple_of(3)).map(|v| vec(v * 7 + t)).collect(),
                })
                .collect(),
            diagonal: 3.0,
            tolerance: Tolerance::ZERO,
            notes: vec![],
        }
    }

    fn assert_decodes(packed: &PackedMesh, mesh: &MorphMesh) {
        for (t, target) in mesh.targets.iter().enumerate() {
            let (ps, ns) = (packed.layout.targets[t].position_step, packed.layout.targets[t].normal_step());
            let mut kept = target.vertices.iter().peekable();
            let mut k = 0;
            for v in 0..mesh.vertex_count() {
                let d = packed.delta(t, v);
                let (p, n) = if kept.next_if_eq(&&(v as u32)).is_some() {
                    k += 1;
                    (target.positions[k - 1], target.normals[k - 1])
                } else {
                    (Vec3::ZERO, Vec3::ZERO)
                };
                for i in 0..3 {
                    let (ep, en) = match packed.layout.format {
                        DeltaFormat::Float32 => (0.0, 0.0),
                        DeltaFormat::Snorm16 => (f64::from(ps) * 0.5001, f64::from(ns) * 0.5001),
                    };
                    assert!((d[i] - f64::from(p[i])).abs() <= ep, "target {t} vertex {v}");
                    assert!((d[3 + i] - f64::from(n[i])).abs() <= en, "target {t} vertex {v}");
                }
            }
        }
    }

    #[test]
    fn decodes_to_what_was_packed_whole_and_in_chunks() {
        let mesh = mesh(200, 5);
        for format in DeltaFormat::ALL {
            for max_chunk_bytes in [128 << 20, 5 * 64 * 24 + 1] {
                let packed =
                    PackedMesh::pack(&mesh, &PackDesc { format, max_chunk_bytes, ..PackDesc::default() }).unwrap();
                let largest = packed.layout.chunks().map(|(_, n)| n * 5 * format.stride()).max().unwrap();
                assert!(largest as u64 <= max_chunk_bytes);
                assert_eq!(packed.layout.chunks().map(|(_, n)| n).sum::<usize>(), 256);
                assert_decodes(&packed, &mesh);
            }
        }
    }

    #[test]
    fn too_many_targets_are_refused_with_the_numbers() {
        let error = PackedMesh::pack(&mesh(3, 4), &PackDesc { max_chunk_bytes: 1000, ..PackDesc::default() });
        let text = error.unwrap_err().to_string();
        assert!(text.contains("4 targets") && text.contains("6144 bytes") && text.contains("1000"), "{text}");
    }

    #[test]
    fn the_normal_step_covers_the_largest_normal() {
        let mesh = mesh(64, 1);
        let packed =
            PackedMesh::pack(&mesh, &PackDesc { format: DeltaFormat::Snorm16, ..PackDesc::default() }).unwrap();
        let largest = mesh.targets[0].normals.iter().map(|n| n.abs().max_element()).fold(0.0, f32::max);
        let step = packed.layout().targets[0].normal_step();
        assert!(step * 32767.0 >= largest && step * 32767.0 <= 2.001 * largest);
    }
}
