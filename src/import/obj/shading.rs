//! From normals per corner, as OBJ has them, to normals per position, as a morph target needs them.

use super::ObjFile;
use crate::asset::normals::area_vector;
use glam::{DVec3, Vec3};

/// The stated normals of a file, one per position.
pub(super) struct Stated {
    /// Where all corners of a position agree, their normal as stated; at a hard edge, their area-weighted mean.
    pub values: Vec<Vec3>,
    /// Number of positions at hard edges.
    pub hard: usize,
}

/// The area of every face of the neutral mesh. Both neutral and targets are averaged with these: a mean with
/// the same weights on both sides makes the delta the mean of the deltas.
pub(super) fn face_areas(neutral: &ObjFile) -> Vec<f64> {
    neutral.faces.iter().map(|face| area_vector(face, &neutral.positions).length()).collect()
}

/// The normals per position that `file` states; `None` where its faces have none, or not everywhere.
///
/// A position that no face names has the `vn` line of its own number where there are as many `vn` as `v` lines,
/// otherwise zero.
pub(super) fn stated(file: &ObjFile, areas: &[f64]) -> Option<Stated> {
    let count = file.positions.len();
    let one_each = file.normals.len() == count;
    // A point cloud has normals when it has one for each of its points.
    let corners = match &file.corner_normals {
        Some(corners) => corners.as_slice(),
        None if file.faces.sizes.is_empty() && one_each => &[],
        None => return None,
    };

    let mut values = if one_each { file.normals.clone() } else { vec![Vec3::ZERO; count] };
    let (mut named, mut hard) = (vec![false; count], vec![false; count]);
    for (corner, &n) in file.faces.corners.iter().zip(corners) {
        let (v, normal) = (corner.position as usize, file.normals[n as usize]);
        match std::mem::replace(&mut named[v], true) {
            true => hard[v] |= values[v] != normal,
            false => values[v] = normal,
        }
    }
    if hard.contains(&true) {
        let mut sums = vec![(DVec3::ZERO, 0.0); count];
        let mut normals = corners.iter();
        for (face, &area) in file.faces.iter().zip(areas) {
            for (corner, &n) in face.iter().zip(&mut normals) {
                let (sum, weight) = &mut sums[corner.position as usize];
                *sum += file.normals[n as usize].as_dvec3() * area;
                *weight += area;
            }
        }
        // Faces without area have no say; where all are such, the first normal stands.
        for (v, (sum, weight)) in sums.into_iter().enumerate().filter(|(v, (_, weight))| hard[*v] && *weight > 0.0) {
            values[v] = (sum / weight).as_vec3();
        }
    }
    Some(Stated { values, hard: hard.iter().filter(|&&h| h).count() })
}
