//! Evaluates a character's file at a time, in float64, by the formulas of glTF 2.0 and of Kavan et al. 2008. Uses no
//! code of the reader or of the library.

use crate::character::{Character, Keys, MESH_NODE, Morphed, Place};

/// In row-major order.
pub type Matrix = [[f64; 4]; 4];

pub fn product(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..4).map(|k| a[i][k] * b[k][j]).sum()))
}

/// Returns translation · rotation · scale; the rotation is a quaternion x y z w of any length but 0.
pub fn matrix_of(translation: &[f64], rotation: &[f64], scale: &[f64]) -> Matrix {
    let length = rotation.iter().map(|x| x * x).sum::<f64>().sqrt();
    let [x, y, z, w] = std::array::from_fn(|i| rotation[i] / length);
    let rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ];
    let row = |i: usize| [rows[i][0] * scale[0], rows[i][1] * scale[1], rows[i][2] * scale[2], translation[i]];
    [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Returns the inverse transpose of the upper three rows and columns: cross products of the other rows, divided by the
/// determinant.
fn normal_matrix(m: &Matrix) -> [[f64; 3]; 3] {
    let [a, b, c] = [0, 1, 2].map(|i| [m[i][0], m[i][1], m[i][2]]);
    let determinant = dot(&a, &cross(b, c));
    [cross(b, c), cross(c, a), cross(a, b)].map(|row| row.map(|x| x / determinant))
}

/// Returns the inverse of an affine matrix.
pub fn inverse(m: &Matrix) -> Matrix {
    let turned = normal_matrix(m);
    let row = |i: usize| {
        let of = [turned[0][i], turned[1][i], turned[2][i]];
        [of[0], of[1], of[2], -dot(&of, &[m[0][3], m[1][3], m[2][3]])]
    };
    [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
}

impl Keys {
    /// Samples a track, by glTF 2.0, appendix C.
    pub fn sample(&self, time: f64) -> Vec<f64> {
        let time = time.clamp(self.times[0].into(), self.times[self.times.len() - 1].into());
        let is_spline = self.interpolation == "CUBICSPLINE";
        let value = |key: usize| self.values.at(if is_spline { 3 * key + 1 } else { key });
        let last = self.times.iter().rposition(|t| f64::from(*t) <= time).unwrap();
        if last + 1 == self.times.len() || self.interpolation == "STEP" {
            return value(last).to_vec();
        }
        let [start, end] = [last, last + 1].map(|key| f64::from(self.times[key]));
        let (length, t) = (end - start, (time - start) / (end - start));
        let (from, to) = (value(last), value(last + 1));
        if is_spline {
            let (out, into) = (self.values.at(3 * last + 2), self.values.at(3 * (last + 1)));
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

impl Morphed {
    /// Returns the first three numbers of vertex `v`.
    fn at(&self, v: usize, weights: &[f64]) -> [f64; 3] {
        let base = self.base.at(v);
        let moved = |i: usize| self.targets.iter().zip(weights).map(|(t, w)| w * t.at(v)[i]).sum::<f64>();
        std::array::from_fn(|i| base[i] + moved(i))
    }
}

/// The reference for a pose.
pub struct Pose {
    /// Six numbers per vertex: position, and normal of unit length.
    pub surface: Vec<f64>,
    /// Morphed but not skinned, of unit length.
    pub tangents: Vec<[f64; 3]>,
    /// Morphed and skinned, of unit length.
    pub skinned_tangents: Vec<[f64; 3]>,
}

/// A clip of the character, and a time.
pub type Playing = Option<(usize, f64)>;

impl Character {
    fn playing(&self, playing: Playing, node: usize, path: &str) -> Option<Vec<f64>> {
        let (clip, time) = playing?;
        let keys = self.animations[clip].iter().find(|keys| keys.node == node && keys.path == path)?;
        Some(keys.sample(time))
    }

    pub fn worlds(&self, playing: Playing) -> Vec<Matrix> {
        fn world(character: &Character, node: usize, playing: Playing) -> Matrix {
            let local = match &character.nodes[node].place {
                Place::Matrix(m) => std::array::from_fn(|i| std::array::from_fn(|j| f64::from(m[4 * j + i]))),
                Place::Parts { translation, rotation, scale } => {
                    let of = |path, rest: &[f32]| {
                        let rest = || rest.iter().map(|x| f64::from(*x)).collect();
                        character.playing(playing, node, path).unwrap_or_else(rest)
                    };
                    let (t, r) = (of("translation", translation), of("rotation", rotation));
                    matrix_of(&t, &r, &of("scale", scale))
                }
            };
            let parent = character.nodes[node].parent;
            parent.map_or(local, |parent| product(&world(character, parent, playing), &local))
        }
        (0..self.nodes.len()).map(|node| world(self, node, playing)).collect()
    }

    pub fn weights_at(&self, playing: Playing) -> Vec<f64> {
        let rest = || self.node_weights.iter().map(|w| f64::from(*w)).collect();
        self.playing(playing, MESH_NODE, "weights").unwrap_or_else(rest)
    }

    /// Returns the pose, blended linearly or by dual quaternions.
    pub fn pose(&self, playing: Playing, by_dual_quaternions: bool) -> Pose {
        let (worlds, weights) = (self.worlds(playing), self.weights_at(playing));
        let joint = |(i, &node): (usize, &usize)| {
            let bind = self.inverse_bind.at(i);
            product(&worlds[node], &std::array::from_fn(|i| std::array::from_fn(|j| bind[4 * j + i])))
        };
        let joints: Vec<Matrix> = self.skin.iter().enumerate().map(joint).collect();
        let mut pose = Pose { surface: vec![], tangents: vec![], skinned_tangents: vec![] };
        for v in 0..self.positions.base.count() {
            let sets = self.joints.iter().zip(&self.weights);
            let influences: Vec<(usize, f64)> = sets
                .flat_map(|(joints, weights)| joints.at(v).iter().zip(weights.at(v)).map(|(j, w)| (*j as usize, *w)))
                .filter(|(_, weight)| *weight > 0.0)
                .collect();
            let all: f64 = influences.iter().map(|(_, weight)| weight).sum();
            let influences: Vec<(&Matrix, f64)> = influences.iter().map(|(j, w)| (&joints[*j], w / all)).collect();
            let blended = match by_dual_quaternions {
                false => linear(&influences),
                true => dual_quaternion(&influences),
            };
            let (p, n) = (self.positions.at(v, &weights), self.normals.at(v, &weights));
            let turned = normal_matrix(&blended).map(|row| dot(&row, &n));
            let length = dot(&turned, &turned).sqrt();
            pose.surface.extend([0, 1, 2].map(|i| dot(&blended[i][..3], &p) + blended[i][3]));
            pose.surface.extend(turned.map(|x| x / length));
            let tangent = self.tangents.at(v, &weights);
            let skinned = [0, 1, 2].map(|i| dot(&blended[i][..3], &tangent));
            let unit = |v: [f64; 3]| v.map(|x| x / dot(&v, &v).sqrt());
            pose.tangents.push(unit(tangent));
            pose.skinned_tangents.push(unit(skinned));
        }
        pose
    }
}

fn linear(influences: &[(&Matrix, f64)]) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| influences.iter().map(|(m, w)| w * m[i][j]).sum()))
}

fn quaternion_product(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    let ([ax, ay, az, aw], [bx, by, bz, bw]) = (a, b);
    [
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    ]
}

/// Returns the quaternion of a rotation: the column of 4 q qᵀ with the largest diagonal.
pub fn quaternion_of(m: &Matrix) -> [f64; 4] {
    let (x, y, z) = (m[0][0], m[1][1], m[2][2]);
    let columns = [
        [1.0 + x - y - z, m[1][0] + m[0][1], m[0][2] + m[2][0], m[2][1] - m[1][2]],
        [m[1][0] + m[0][1], 1.0 - x + y - z, m[2][1] + m[1][2], m[0][2] - m[2][0]],
        [m[0][2] + m[2][0], m[2][1] + m[1][2], 1.0 - x - y + z, m[1][0] - m[0][1]],
        [m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1], 1.0 + x + y + z],
    ];
    let largest = (0..4).max_by(|a, b| columns[*a][*a].total_cmp(&columns[*b][*b])).unwrap();
    let length = dot(&columns[largest], &columns[largest]).sqrt();
    columns[largest].map(|x| x / length)
}

fn dual_quaternion(influences: &[(&Matrix, f64)]) -> Matrix {
    let first = influences.iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
    let pivot = quaternion_of(first.0);
    let (mut real, mut dual) = ([0.0; 4], [0.0; 4]);
    for (matrix, weight) in influences {
        let rotation = quaternion_of(matrix);
        let translation = [matrix[0][3], matrix[1][3], matrix[2][3], 0.0];
        let half = quaternion_product(translation, rotation).map(|x| x / 2.0);
        let weight = weight * dot(&rotation, &pivot).signum();
        real = std::array::from_fn(|i| real[i] + weight * rotation[i]);
        dual = std::array::from_fn(|i| dual[i] + weight * half[i]);
    }
    let length = dot(&real, &real);
    let moved = quaternion_product(dual, [-real[0], -real[1], -real[2], real[3]]).map(|x| 2.0 * x / length);
    matrix_of(&moved[..3], &real, &[1.0; 3])
}
