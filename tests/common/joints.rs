//! A random skeleton, and the buffer of its joints.

use crate::prelude::*;

pub const JOINTS: u32 = 23;
/// The joint that is mirrored.
pub const MIRRORED: u16 = JOINTS as u16 - 1;

fn random(rng: &mut Rng) -> f32 {
    rng.range(-1.0, 1.0)
}

/// Returns a pose of the skeleton for a method: rotated by up to 0.6 radians, moved by up to a fifth of the diagonal;
/// matrices are also scaled unevenly, and one is mirrored. Half of the quaternions are negated relative to their
/// neighbours.
fn skeleton(method: SkinMethod, diagonal: f32, seed: u64) -> Vec<f32> {
    let mut rng = Rng::new(seed, 1);
    let mut numbers = vec![];
    for joint in 0..JOINTS {
        let axis = glam::Vec3::new(random(&mut rng), random(&mut rng), random(&mut rng)).normalize();
        let rotation = glam::Quat::from_axis_angle(axis, 0.6 * random(&mut rng));
        let moved = glam::Vec3::new(random(&mut rng), random(&mut rng), random(&mut rng)) * 0.2 * diagonal;
        if method == SkinMethod::DualQuaternion {
            let sign = if joint % 2 == 0 { 1.0 } else { -1.0 };
            let dual = glam::Quat::from_xyzw(moved.x, moved.y, moved.z, 0.0) * rotation * 0.5;
            numbers.extend((rotation * sign).to_array());
            numbers.extend((dual * sign).to_array());
            continue;
        }
        let mirror = if joint == u32::from(MIRRORED) { -1.0 } else { 1.0 };
        let scale = glam::Vec3::new(mirror, 1.0 + 0.5 * random(&mut rng), 1.0 + 0.5 * random(&mut rng));
        let rows = glam::Mat3::from_quat(rotation) * glam::Mat3::from_diagonal(scale);
        let rows = rows.transpose();
        for (row, moved) in [rows.x_axis, rows.y_axis, rows.z_axis].into_iter().zip(moved.to_array()) {
            numbers.extend([row.x, row.y, row.z, moved]);
        }
    }
    numbers
}

/// The joints of an instance, at two alternating places of a buffer.
pub struct Joints<'a> {
    host: &'a Buffers<'a>,
    pub shared: Shared,
    method: SkinMethod,
    diagonal: f32,
    turn: u64,
    pub numbers: Vec<f32>,
}

impl<'a> Joints<'a> {
    /// Bytes from one place to the other, before the first, and after the second.
    pub const STRIDE: u64 = 16 * 72;

    pub fn new(host: &'a Buffers<'a>, method: SkinMethod, diagonal: f32) -> Self {
        let shared = host.shared(3 * Self::STRIDE as usize);
        let mut this = Self { host, shared, method, diagonal, turn: 0, numbers: vec![] };
        this.turn(1);
        this
    }

    /// Writes other joints to the other place.
    pub fn turn(&mut self, seed: u64) {
        self.turn = 1 - self.turn;
        self.numbers = skeleton(self.method, self.diagonal, seed);
        self.host.write(&self.shared, self.offset(), &self.numbers);
    }

    pub fn offset(&self) -> u64 {
        16 + self.turn * Self::STRIDE
    }
}
