//! Numbers of enumerations: stable, never reused; 0 is the default of each.

use crate::result::{Failure, Result};
use deltamorph::after::SkinMethod;
use deltamorph::{Consumers, DeltaFormat, PoseFormat, Semantic, UpdateMode, UpdatePath};

/// Vertices are doubled at seams, so that one index buffer draws poses as they are.
pub const DM_MESH_SPLIT: u32 = 1;
/// Vertices at the same position in the base pose and all targets get the same deltas and, if they are computed, the
/// same normals: for meshes that come doubled at seams, which otherwise may open. The vertices stay, in number and
/// order. Packing takes half as long again (fast) or a tenth longer (small). With `DM_MESH_SPLIT` as well, seams are
/// doubled first.
pub const DM_MESH_WELD: u32 = 2;
/// Keep all deltas except zeros.
pub const DM_MESH_KEEP_ALL: u32 = 4;

/// How the mesh differs from its file: what was left out, merged, averaged or computed. Later versions may have further
/// severities; greater ones are worse.
pub const DM_MESSAGE_NOTE: u32 = 1;

/// Dense, six float32.
pub const DM_DELTAS_FLOAT32: u32 = 1;
/// Dense, six integers of 16 bits.
pub const DM_DELTAS_SNORM16: u32 = 2;
/// In blocks, 9 bytes a vertex: the default.
pub const DM_DELTAS_FAST: u32 = 4;
/// In blocks, as few bits as the error allows.
pub const DM_DELTAS_SMALL: u32 = 5;

/// Six float32.
pub const DM_POSE_FLOAT32: u32 = 1;
/// Six integers of 32 bits, without drift.
pub const DM_POSE_FIXED32: u32 = 2;
/// Six integers of 16 bits, without drift.
pub const DM_POSE_FIXED16: u32 = 3;
/// Like `DM_POSE_FIXED16`, and decoded like it, but the sum is rounded once: for rigs with many overlapping targets
/// (`DM_PATH_BLOCKS`, block formats).
pub const DM_POSE_REBUILT16: u32 = 4;

/// Compute, only for the blocks of vertices that changed targets move (block formats).
pub const DM_PATH_BLOCKS: u32 = 1;
/// Compute passes over whole poses (dense formats).
pub const DM_PATH_COMPUTE: u32 = 2;
/// Vertex passes with transform feedback (dense formats).
pub const DM_PATH_FEEDBACK: u32 = 3;

/// Changed targets are added to the existing pose.
pub const DM_MODE_INCREMENTAL: u32 = 1;
/// All active targets are added to the base pose.
pub const DM_MODE_REBUILD: u32 = 2;

/// Draws that fetch poses as vertex attributes.
pub const DM_READ_BY_VERTEX_ATTRIBUTES: u32 = 1;
/// Vertex shaders that read poses from storage buffers.
pub const DM_READ_BY_VERTEX_SHADERS: u32 = 2;
/// Compute shaders.
pub const DM_READ_BY_COMPUTE_SHADERS: u32 = 4;
/// Copies.
pub const DM_READ_BY_COPIES: u32 = 8;
/// Builds of acceleration structures, from decoded positions.
pub const DM_READ_BY_ACCELERATION_STRUCTURES: u32 = 16;

/// Task and mesh shaders that read poses from storage buffers. The device enables both (VK_EXT_mesh_shader).
pub const DM_READ_BY_MESH_SHADERS: u32 = 32;
/// Fragment shaders that read poses from storage buffers.
pub const DM_READ_BY_FRAGMENT_SHADERS: u32 = 64;
/// Shaders of ray-tracing pipelines that read poses from storage buffers. The device enables these pipelines
/// (VK_KHR_ray_tracing_pipeline).
pub const DM_READ_BY_RAY_TRACING_SHADERS: u32 = 128;

/// Linear blend: a joint is twelve float32, the first three rows of its matrix (joint to model x inverse bind matrix).
pub const DM_SKIN_LINEAR: u32 = 1;
/// Dual quaternions: a joint is eight float32, a unit quaternion (x, y, z, w) and the dual part, half of translation x
/// rotation.
pub const DM_SKIN_DUAL_QUATERNION: u32 = 2;

/// Position: three components.
pub const DM_STREAM_POSITION: u32 = 1;
/// Normal: three components.
pub const DM_STREAM_NORMAL: u32 = 2;
/// Direction of the texture's u axis, and handedness: four components.
pub const DM_STREAM_TANGENT: u32 = 3;
/// A set of texture coordinates: two components. Sets are counted from 0; add 256 × set.
pub const DM_STREAM_TEXCOORD: u32 = 4;
/// A set of colours with opacity: four components. Sets are counted from 0; add 256 × set.
pub const DM_STREAM_COLOR: u32 = 5;
/// Wrinkle masks: two components, how far the skin is compressed upwards and across.
pub const DM_STREAM_MASK: u32 = 6;

const DELTAS: &[(u32, DeltaFormat)] = &[
    (DM_DELTAS_FLOAT32, DeltaFormat::Float32),
    (DM_DELTAS_SNORM16, DeltaFormat::Snorm16),
    (DM_DELTAS_FAST, DeltaFormat::Fast),
    (DM_DELTAS_SMALL, DeltaFormat::Small),
];

const POSES: &[(u32, PoseFormat)] = &[
    (DM_POSE_FLOAT32, PoseFormat::Float32),
    (DM_POSE_FIXED32, PoseFormat::Fixed32),
    (DM_POSE_FIXED16, PoseFormat::Fixed16),
    (DM_POSE_REBUILT16, PoseFormat::Rebuilt16),
];

const PATHS: &[(u32, UpdatePath)] = &[
    (DM_PATH_BLOCKS, UpdatePath::Blocks),
    (DM_PATH_COMPUTE, UpdatePath::Compute),
    (DM_PATH_FEEDBACK, UpdatePath::Feedback),
];

const MODES: &[(u32, UpdateMode)] =
    &[(DM_MODE_INCREMENTAL, UpdateMode::Incremental), (DM_MODE_REBUILD, UpdateMode::Rebuild)];

const SKINS: &[(u32, SkinMethod)] =
    &[(DM_SKIN_LINEAR, SkinMethod::Linear), (DM_SKIN_DUAL_QUATERNION, SkinMethod::DualQuaternion)];

/// The value of `number`; `default` for 0.
fn find<T: Copy>(table: &[(u32, T)], number: u32, what: &str, default: T) -> Result<T> {
    match table.iter().find(|(n, _)| *n == number) {
        _ if number == 0 => Ok(default),
        Some((_, value)) => Ok(*value),
        None => Err(Failure::invalid(format!("{number} is no {what}; use a constant of the header"))),
    }
}

/// The number of `value`; 0 where this version of the header has none.
fn number<T: PartialEq>(table: &[(u32, T)], value: T) -> u32 {
    table.iter().find(|(_, v)| *v == value).map_or(0, |(n, _)| *n)
}

/// `DM_DELTAS_…`.
pub fn delta_format(number: u32) -> Result<DeltaFormat> {
    find(DELTAS, number, "format of deltas (DM_DELTAS_)", DeltaFormat::Fast)
}

/// `DM_DELTAS_…`.
pub fn delta_number(format: DeltaFormat) -> u32 {
    number(DELTAS, format)
}

/// `DM_POSE_…`.
pub fn pose_format(number: u32, default: PoseFormat) -> Result<PoseFormat> {
    find(POSES, number, "format of poses (DM_POSE_)", default)
}

/// `DM_POSE_…`.
pub fn pose_number(format: PoseFormat) -> u32 {
    number(POSES, format)
}

/// `DM_PATH_…`.
pub fn path(number: u32) -> Result<UpdatePath> {
    find(PATHS, number, "update path (DM_PATH_)", UpdatePath::Blocks)
}

/// `DM_MODE_…`.
pub fn mode(number: u32, default: UpdateMode) -> Result<UpdateMode> {
    find(MODES, number, "mode (DM_MODE_)", default)
}

/// `DM_SKIN_…`.
pub fn skin_method(number: u32) -> Result<SkinMethod> {
    find(SKINS, number, "method of skinning (DM_SKIN_)", SkinMethod::Linear)
}

/// `DM_READ_BY_…`, combined.
pub fn consumers(bits: u32) -> Result<Consumers> {
    let named = Consumers::from_bits(bits).ok_or_else(|| {
        Failure::invalid(format!("{bits:#x} names consumers that are unknown; combine DM_READ_BY_ constants"))
    })?;
    Ok(if bits == 0 { Consumers::default() } else { named })
}

/// `DM_STREAM_…`, with the set.
pub fn semantic(number: u32) -> Result<Semantic> {
    Semantic::from_id(number).ok_or_else(|| {
        Failure::invalid(format!("{number} is no stream; use a DM_STREAM_ constant, or one plus 256 × set"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The values of the header's constants whose names begin with `prefix`.
    fn constants(prefix: &str) -> Vec<u32> {
        let lines = include_str!("numbers.rs").lines().filter_map(|line| line.strip_prefix("pub const "));
        let named = lines.filter(|line| line.starts_with(prefix)).filter_map(|line| line.split_once(": u32 = "));
        named.map(|(_, number)| number.trim_end_matches(';').parse().expect("a number")).collect()
    }

    /// Each of `all` has a number, each constant of the header is one of these, and each number is read back as its
    /// value.
    fn check<T: Copy + PartialEq + std::fmt::Debug>(
        prefix: &str,
        all: impl IntoIterator<Item = T>,
        table: &[(u32, T)],
        read: impl Fn(u32) -> Result<T>,
    ) {
        let numbers: Vec<u32> = all.into_iter().map(|value| number(table, value)).collect();
        let mut sorted = numbers.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, constants(prefix), "{prefix}");
        numbers.iter().for_each(|&n| assert_eq!(number(table, read(n).expect("a constant")), n, "{prefix}"));
    }

    #[test]
    fn every_item_of_the_library_has_a_number_and_zero_is_the_default() {
        check("DM_DELTAS_", DeltaFormat::ALL, DELTAS, delta_format);
        check("DM_POSE_", PoseFormat::ALL, POSES, |n| pose_format(n, PoseFormat::Fixed32));
        let ours = UpdatePath::ALL.into_iter().filter(|path| *path != UpdatePath::Cpu);
        check("DM_PATH_", ours, PATHS, path);
        let bits = (0..32).map(|bit| 1 << bit).filter(|bit| Consumers::from_bits(*bit).is_some());
        assert_eq!(bits.collect::<Vec<u32>>(), constants("DM_READ_BY_"));
        let kinds = (0..256).filter(|kind| Semantic::from_id(*kind).is_some());
        assert_eq!(kinds.collect::<Vec<u32>>(), constants("DM_STREAM_"));
        assert_eq!(delta_format(0).unwrap(), DeltaFormat::Fast);
        assert_eq!(mode(0, UpdateMode::Rebuild).unwrap(), UpdateMode::Rebuild);
        assert_eq!(skin_method(0).unwrap(), SkinMethod::Linear);
        assert_eq!(skin_method(DM_SKIN_DUAL_QUATERNION).unwrap(), SkinMethod::DualQuaternion);
        assert_eq!(consumers(0).unwrap(), Consumers::default());
        assert_eq!(consumers(9).unwrap(), Consumers::VERTEX_ATTRIBUTES | Consumers::COPIES);
        let late = Consumers::MESH_SHADERS | Consumers::FRAGMENT_SHADERS | Consumers::RAY_TRACING_SHADERS;
        assert_eq!(consumers(32 | 64 | 128).unwrap(), late);
        assert_eq!(semantic(4 + 256 * 3).unwrap(), Semantic::TexCoord(3));
        assert_eq!(semantic(DM_STREAM_MASK).unwrap(), Semantic::Mask);
    }
}
