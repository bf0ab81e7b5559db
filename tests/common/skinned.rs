//! Matrices and tracks in float64, by the formulas of glTF 2.0. Uses no code of the reader or of the library.

use crate::character::{Character, Keys, Place};

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

pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Returns the inverse transpose of the upper three rows and columns: cross products of the other rows, divided by the
/// determinant.
pub fn normal_matrix(m: &Matrix) -> [[f64; 3]; 3] {
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

/// A clip of the character, and a time.
pub type Playing = Option<(usize, f64)>;

impl Character {
    /// Returns the matrices of nodes at rest.
    pub fn worlds(&self) -> Vec<Matrix> {
        fn world(character: &Character, node: usize) -> Matrix {
            let local = match &character.nodes[node].place {
                Place::Matrix(m) => std::array::from_fn(|i| std::array::from_fn(|j| f64::from(m[4 * j + i]))),
                Place::Parts { translation, rotation, scale } => {
                    let scale = scale.map(f64::from);
                    matrix_of(&translation.map(f64::from), &rotation.map(f64::from), &scale)
                }
            };
            character.nodes[node].parent.map_or(local, |parent| product(&world(character, parent), &local))
        }
        (0..self.nodes.len()).map(|node| world(self, node)).collect()
    }
}
