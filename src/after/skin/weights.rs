//! Which joints move which vertices, and how much.

use crate::error::{Error, Result};
use crate::pack::PackedLayout;

/// How joints that move a vertex together are blended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum SkinMethod {
    /// Linear blend: Σ weight · matrix. A joint is twelve float32, the first three rows of its matrix, row after row:
    /// what it does to a point of the bind pose in the mesh's space (joint to model × inverse bind matrix). Scale,
    /// shear and mirrored joints are allowed.
    ///
    /// Normals are multiplied by the inverse transpose of the blended 3×3 matrix, which is right under non-uniform
    /// scale: with the matrix itself they would be off by up to 19° where one axis is scaled by 1.4, and 37° where it
    /// is doubled. That weights vary over the surface is left out, as usual.
    #[default]
    Linear,
    /// Dual quaternions (Kavan et al. 2008, "Geometric Skinning with Approximate Dual Quaternion Blending"): joints do
    /// not collapse where they twist. A joint is eight float32: a unit quaternion (x, y, z, w), the rotation r; and the
    /// dual part ½ t r, where t is the translation as a quaternion (x, y, z, 0). A quaternion and its negative are the
    /// same rotation; each is taken on the side of the one that weighs most.
    ///
    /// It has no scale: normals are rotated, which is exact for the rigid motions there are. A skeleton that scales
    /// takes [`Linear`](Self::Linear).
    DualQuaternion,
}

impl SkinMethod {
    /// Bytes of a joint.
    pub const fn joint_bytes(self) -> u64 {
        match self {
            Self::Linear => 48,
            Self::DualQuaternion => 32,
        }
    }
}

/// Which joints move the vertices of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct SkinDesc<'a> {
    /// Joints that a vertex names: 4 or 8.
    pub influences: u32,
    /// Joints there are: 1 to 65,536.
    pub joint_count: u32,
    /// For each vertex, in the user's order, its joints: below `joint_count`. Those whose weight is 0 are not used.
    pub joints: &'a [u16],
    /// The weights of these joints: not negative, of any sum above 0. They are divided by it.
    pub weights: &'a [f32],
}

impl<'a> SkinDesc<'a> {
    /// All there is to say. `joints` and `weights`: `influences` of each vertex, one vertex after the other.
    pub fn new(influences: u32, joint_count: u32, joints: &'a [u16], weights: &'a [f32]) -> Self {
        Self { influences, joint_count, joints, weights }
    }

    /// Joints and weights of each vertex, of a mesh of `vertices`.
    ///
    /// # Errors
    /// What [`MorphEngine::upload_skin`](crate::MorphEngine::upload_skin) refuses of it.
    pub(super) fn vertices(&self, vertices: usize) -> Result<impl Iterator<Item = (&'a [u16], &'a [f32])>> {
        let Self { influences, joint_count, joints, weights } = *self;
        if !matches!(influences, 4 | 8) || !(1..=1 << 16).contains(&joint_count) {
            let text = format!("a skin of {influences} influences for each vertex, and {joint_count} joints");
            return Err(Error::invalid(text, "use 4 or 8 influences, and 1 to 65536 joints"));
        }
        let (n, wanted) = (influences as usize, vertices * influences as usize);
        if (joints.len(), weights.len()) != (wanted, wanted) {
            let text = format!("a skin with {} joints and {} weights of vertices", joints.len(), weights.len());
            let remedy = format!("hand in {wanted} of both: {n} for each of the {vertices} vertices of the mesh");
            return Err(Error::invalid(text, remedy));
        }
        let each = joints.chunks_exact(n).zip(weights.chunks_exact(n));
        for (vertex, (joints, weights)) in each.clone().enumerate() {
            let refused = |text: String, remedy| Err(Error::invalid(format!("skin: vertex {vertex} {text}"), remedy));
            if let Some(bad) = weights.iter().find(|weight| !(weight.is_finite() && **weight >= 0.0)) {
                return refused(format!("has the weight {bad}"), "use weights from 0 on");
            }
            if weights.iter().all(|weight| *weight == 0.0) {
                return refused("has weights that sum to 0".into(), "give it a joint, such as the root, with weight 1");
            }
            let mut used = joints.iter().zip(weights).filter(|(_, weight)| **weight > 0.0);
            if let Some((bad, _)) = used.find(|(joint, _)| u32::from(**joint) >= joint_count) {
                return refused(format!("names joint {bad}"), "name joints below the joint count");
            }
        }
        Ok(each)
    }

    /// The words that `skin.comp` reads, vertex after vertex in the order of poses: joints, two to a word, then weights
    /// as float32, the largest first. Padding has none: no lane takes it.
    pub(super) fn pack(&self, layout: &PackedLayout) -> Result<Vec<u32>> {
        let n = self.influences as usize;
        let vertices: Vec<_> = self.vertices(layout.vertex_count)?.collect();
        let mut words = Vec::with_capacity(layout.vertex_count * (n + n / 2));
        for user in (0..layout.padded_vertices()).filter_map(|packed| layout.user_vertex(packed)) {
            let (joints, weights) = vertices[user];
            // In double precision: float32 weights may sum to more than a float32 holds.
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
