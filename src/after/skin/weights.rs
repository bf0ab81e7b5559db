//! Joints and weights of vertices.

use crate::error::{Error, Result, ensure};
use crate::pack::PackedLayout;

/// How the joints of a vertex are blended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum SkinMethod {
    /// Linear blending: Σ weight · matrix. A joint is twelve float32, the first three rows of the matrix that maps a
    /// point of the bind pose in mesh space (joint to model × inverse bind matrix). Scale, shear and mirroring are
    /// allowed.
    ///
    /// Normals are multiplied by the inverse transpose of the blended 3×3 matrix, which is correct under non-uniform
    /// scale; with the matrix itself they would be off by up to 19° if one axis is scaled by 1.4, and 37° if it is
    /// doubled. Variation of weights over the surface is ignored, as usual.
    #[default]
    Linear,
    /// Dual quaternions (Kavan et al. 2008, "Geometric Skinning with Approximate Dual Quaternion Blending"), which
    /// avoid collapsing at twisted joints. A joint is eight float32: a unit quaternion (x, y, z, w), the rotation r;
    /// and the dual part ½ t r, where t is the translation as a quaternion (x, y, z, 0). Quaternions are negated to the
    /// side of the one with the largest weight, since q and −q are the same rotation.
    ///
    /// Rigid motions only, for which rotating normals is exact; a skeleton with scale needs [`Linear`](Self::Linear).
    DualQuaternion,
}

impl SkinMethod {
    /// Bytes per joint.
    pub(crate) const fn joint_bytes(self) -> u64 {
        match self {
            Self::Linear => 48,
            Self::DualQuaternion => 32,
        }
    }
}

/// Joints and weights of a mesh's vertices.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SkinDesc<'a> {
    /// Joints per vertex: 4 or 8.
    pub influences: u32,
    /// Number of joints: 1 to 65,536.
    pub joint_count: u32,
    /// `influences` joint indices per vertex, in the user's order, below `joint_count`. Those of weight 0 are ignored.
    pub joints: &'a [u16],
    /// Weights of these joints: not negative, with a positive sum per vertex, by which they are divided.
    pub weights: &'a [f32],
}

impl<'a> SkinDesc<'a> {
    /// Joints and weights of each of `vertices` vertices.
    ///
    /// # Errors
    /// A skin that [`MorphEngine::upload_skin`](crate::MorphEngine::upload_skin) rejects.
    pub(super) fn vertices(&self, vertices: usize) -> Result<impl Iterator<Item = (&'a [u16], &'a [f32])>> {
        let Self { influences, joint_count, joints, weights } = *self;
        let text = format!("a skin of {influences} influences for each vertex, and {joint_count} joints");
        let fits = matches!(influences, 4 | 8) && (1..=1 << 16).contains(&joint_count);
        ensure!(fits, text, "use 4 or 8 influences, and 1 to 65536 joints");
        let n = influences as usize;
        let wanted = vertices * n;
        let text = format!("a skin with {} joints and {} weights of vertices", joints.len(), weights.len());
        let remedy = format!("hand in {wanted} of both: {n} for each of the {vertices} vertices of the mesh");
        ensure!((joints.len(), weights.len()) == (wanted, wanted), text, remedy);
        let each = joints.chunks_exact(n).zip(weights.chunks_exact(n));
        for (vertex, (joints, weights)) in each.clone().enumerate() {
            let refuse = |text: String, remedy| Error::invalid(format!("skin: vertex {vertex} {text}"), remedy);
            for weight in weights {
                let fits = weight.is_finite() && *weight >= 0.0;
                ensure!(fits, refuse(format!("has the weight {weight}"), "use weights from 0 on"));
            }
            let remedy = "give it a joint, such as the root, with weight 1";
            ensure!(weights.iter().any(|w| *w != 0.0), refuse("has weights that sum to 0".into(), remedy));
            for (joint, _) in joints.iter().zip(weights).filter(|(_, weight)| **weight > 0.0) {
                let fits = u32::from(*joint) < joint_count;
                ensure!(fits, refuse(format!("names joint {joint}"), "name joints below the joint count"));
            }
        }
        Ok(each)
    }

    /// Words for `skin.comp`, vertex by vertex in pose-buffer order: joints, two per word, then float32 weights, the
    /// largest first. Without padding vertices, which no invocation processes.
    pub(super) fn pack(&self, layout: &PackedLayout) -> Result<Vec<u32>> {
        let n = self.influences as usize;
        let vertices: Vec<_> = self.vertices(layout.vertex_count)?.collect();
        let mut words = Vec::with_capacity(layout.vertex_count * (n + n / 2));
        for user in (0..layout.padded_vertices()).filter_map(|packed| layout.user_vertex(packed)) {
            let (joints, weights) = vertices[user];
            // In double precision: the sum of float32 weights may overflow a float32.
            let sum: f64 = weights.iter().map(|weight| f64::from(*weight)).sum();
            let share = |(joint, weight): (&u16, &f32)| match (f64::from(*weight) / sum) as f32 {
                0.0 => (0, 0.0),
                share => (*joint, share),
            };
            let mut influences: Vec<(u16, f32)> = joints.iter().zip(weights).map(share).collect();
            influences.sort_by(|a, b| b.1.total_cmp(&a.1));
            words.extend(influences.chunks_exact(2).map(|two| u32::from(two[0].0) | u32::from(two[1].0) << 16));
            words.extend(influences.iter().map(|(_, weight)| weight.to_bits()));
        }
        Ok(words)
    }
}
