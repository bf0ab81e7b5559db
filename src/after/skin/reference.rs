//! Skinning in float64.

use super::{SkinDesc, SkinMethod};
use crate::error::{Result, ensure};
use glam::{DMat3, DQuat, DVec3};

/// Skins a pose in double precision: the reference of outputs with [`Joints`](crate::after::Joints). `pose` and the
/// result have six numbers per vertex in the user's order, as from [`evaluate`](crate::reference::evaluate). Normals of
/// the result have unit length, or are 0 if the pose's are. `joints` in the layout of `method`.
///
/// # Errors
/// A skin that [`upload_skin`](crate::MorphEngine::upload_skin) rejects; too few joints.
pub fn skin(pose: &[f64], desc: &SkinDesc<'_>, method: SkinMethod, joints: &[f32]) -> Result<Vec<f64>> {
    let (pose, size) = (pose.as_chunks::<6>().0, method.joint_bytes() as usize / 4);
    let text = format!("{} numbers for {} joints", joints.len(), desc.joint_count);
    let fits = joints.len() >= size * desc.joint_count as usize;
    ensure!(fits, text, format!("hand in {size} for each joint"));
    let joint = |number: u16| -> Vec<f64> {
        joints[usize::from(number) * size..][..size].iter().map(|x| f64::from(*x)).collect()
    };
    let mut skinned = Vec::with_capacity(pose.len() * 6);
    for (vertex, (joint_numbers, weights)) in pose.iter().zip(desc.vertices(pose.len())?) {
        let sum: f64 = weights.iter().map(|weight| f64::from(*weight)).sum();
        let used = joint_numbers.iter().zip(weights).filter(|(_, weight)| **weight > 0.0);
        let mut used: Vec<(Vec<f64>, f64)> = used.map(|(j, weight)| (joint(*j), f64::from(*weight) / sum)).collect();
        used.sort_by(|a, b| b.1.total_cmp(&a.1));
        let (position, normal) = (DVec3::from_slice(vertex), DVec3::from_slice(&vertex[3..]));
        let (position, normal) = match method {
            SkinMethod::Linear => linear(&used, position, normal),
            SkinMethod::DualQuaternion => dual_quaternion(&used, position, normal),
        };
        skinned.extend(position.to_array());
        skinned.extend(normal.normalize_or_zero().to_array());
    }
    Ok(skinned)
}

fn linear(joints: &[(Vec<f64>, f64)], position: DVec3, normal: DVec3) -> (DVec3, DVec3) {
    let mut sum = [0.0; 12];
    for (rows, weight) in joints {
        sum.iter_mut().zip(rows).for_each(|(sum, x)| *sum += weight * x);
    }
    let row = |i: usize| DVec3::from_slice(&sum[4 * i..]);
    let matrix = DMat3::from_cols(row(0), row(1), row(2)).transpose();
    let translation = DVec3::new(sum[3], sum[7], sum[11]);
    (matrix * position + translation, matrix.inverse().transpose() * normal)
}

fn dual_quaternion(joints: &[(Vec<f64>, f64)], position: DVec3, normal: DVec3) -> (DVec3, DVec3) {
    let parts = |q: &[f64]| (DQuat::from_slice(q), DQuat::from_slice(&q[4..]));
    let pivot = parts(&joints[0].0).0;
    let (mut real, mut dual) = (DQuat::from_array([0.0; 4]), DQuat::from_array([0.0; 4]));
    for (joint, weight) in joints {
        let (rotation, translation) = parts(joint);
        let weight = if rotation.dot(pivot) < 0.0 { -weight } else { *weight };
        (real, dual) = (real + rotation * weight, dual + translation * weight);
    }
    let (real, dual) = (real * real.length().recip(), dual * real.length().recip());
    // The translation is twice the vector part of dual × conjugate(real).
    let moved = dual * real.conjugate() * 2.0;
    let rotate = |v: DVec3| {
        let turned = real * DQuat::from_xyzw(v.x, v.y, v.z, 0.0) * real.conjugate();
        DVec3::new(turned.x, turned.y, turned.z)
    };
    (rotate(position) + DVec3::new(moved.x, moved.y, moved.z), rotate(normal))
}
