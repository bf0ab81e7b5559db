//! Cameras, placed so that the whole scene is in the picture.

use glam::{Mat4, Vec3, Vec4};

/// The direction from which a mesh is seen. The mesh faces +z, and y points up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Degrees around the vertical: 0 from the front, 90 from the mesh's own left (+x), 180 from behind.
    pub yaw: f32,
    /// Degrees from above (−90 to 90).
    pub pitch: f32,
    /// Angle of view from bottom to top, in degrees (above 0, below 180).
    pub angle: f32,
}

impl Default for Camera {
    fn default() -> Self {
        Self { yaw: 0.0, pitch: 0.0, angle: 24.0 }
    }
}

/// A camera at its position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// From the mesh's space to Vulkan's clip space: y down, depth from 0 to 1.
    pub clip: Mat4,
    /// Position of the camera.
    pub eye: Vec3,
    /// Axes of unit length: to the right, up, and towards the camera.
    pub axes: [Vec3; 3],
    /// A ball around the scene: its middle and its radius.
    pub ball: (Vec3, f32),
}

impl View {
    /// Extends the depth of the view to these points as well, which need not be within its frame.
    pub fn reach(&mut self, points: impl Iterator<Item = Vec3>) {
        let [.., back] = self.axes;
        let away = |p: Vec3| back.dot(self.eye - p);
        let (nearest, furthest) =
            points.filter(|p| p.is_finite()).map(away).fold((f32::MAX, 0.0f32), |(n, f), a| (n.min(a), f.max(a)));
        let distance = away(self.ball.0);
        let radius = self.ball.1;
        let least = distance * 0.02;
        let near = (distance - 1.5 * radius).max(least);
        let far = distance + 1.5 * radius;
        if nearest >= near && furthest <= far {
            return;
        }
        let near = (nearest - 0.1 * radius).clamp(least, near);
        let far = far.max(furthest + 0.1 * radius);
        let deep = far / (near - far);
        let row = (back * deep).extend(near * deep - deep * back.dot(self.eye));
        let transposed = self.clip.transpose();
        self.clip = Mat4::from_cols(transposed.x_axis, transposed.y_axis, row, transposed.w_axis).transpose();
    }
}

/// Returns a direction in the system of `axes`: degrees to the right and up, from the direction towards the camera.
pub fn direction(axes: [Vec3; 3], yaw: f32, pitch: f32) -> Vec3 {
    let ((sin, cos), (up, level)) = (yaw.to_radians().sin_cos(), pitch.to_radians().sin_cos());
    axes[0] * (sin * level) + axes[1] * up + axes[2] * (cos * level)
}

impl Camera {
    /// Returns the view in which `points` fill a picture of this ratio of width to height, except for a `margin` (a
    /// share of it, such as 0.1) at each edge. Points that are not finite are left out; without points, a ball of
    /// radius 1 is in view.
    pub fn fit(&self, points: impl Iterator<Item = Vec3> + Clone, aspect: f32, margin: f32) -> View {
        let back = direction([Vec3::X, Vec3::Y, Vec3::Z], self.yaw, self.pitch);
        // The right axis stays level, even in views from straight above or below.
        let right = direction([Vec3::X, Vec3::Y, Vec3::Z], self.yaw + 90.0, 0.0);
        let axes = [right, back.cross(right), back];
        let seen = |p: Vec3| Vec3::from(axes.map(|axis| axis.dot(p)));
        let points = points.filter(|p| p.is_finite()).map(seen);
        let mut low = Vec3::MAX;
        let mut high = Vec3::MIN;
        points.clone().for_each(|p| (low, high) = (low.min(p), high.max(p)));
        if low.x > high.x {
            (low, high) = (Vec3::NEG_ONE, Vec3::ONE);
        }
        let middle = (low + high) / 2.0;
        let half = (self.angle.to_radians() / 2.0).tan();
        let across = half * aspect * (1.0 - margin);
        let up = half * (1.0 - margin);
        let needed = |p: Vec3| (p.x / across).abs().max((p.y / up).abs()) + p.z;
        let radius = points.clone().map(|p| p.distance_squared(middle)).fold(0.0, f32::max).sqrt();
        let radius = if radius > 0.0 { radius } else { 1.0 };
        let distance = points.map(|p| needed(p - middle)).fold(radius * 0.2, f32::max) + radius * 1e-3;
        let centre = axes[0] * middle.x + axes[1] * middle.y + axes[2] * middle.z;
        let eye = centre + back * distance;
        // Wider than the fitted base pose, since poses reach further.
        let near = (distance - 1.5 * radius).max(distance * 0.02);
        let far = distance + 1.5 * radius;
        let row = |axis: Vec3| axis.extend(-axis.dot(eye));
        let to_camera = Mat4::from_cols(row(axes[0]), row(axes[1]), row(axes[2]), Vec4::W).transpose();
        // Depth is 0 at `near` and 1 at `far`; Vulkan's y points down.
        let flat = 1.0 / half;
        let deep = far / (near - far);
        let projection = Mat4::from_cols(
            Vec4::new(flat / aspect, 0.0, 0.0, 0.0),
            Vec4::new(0.0, -flat, 0.0, 0.0),
            Vec4::new(0.0, 0.0, deep, -1.0),
            Vec4::new(0.0, 0.0, near * deep, 0.0),
        );
        let clip = projection * to_camera;
        View { clip, eye, axes, ball: (centre, radius) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corners() -> impl Iterator<Item = Vec3> + Clone {
        (0..8).map(|i| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32 * 3.0, (i >> 2) as f32 * 2.0) - 0.5)
    }

    #[test]
    fn everything_is_in_the_picture_and_fills_it() {
        for yaw in [-170.0, -35.0, 0.0, 90.0, 180.0] {
            for pitch in [-90.0, -20.0, 0.0, 45.0, 90.0] {
                for aspect in [0.4, 1.0, 2.5] {
                    let camera = Camera { yaw, pitch, angle: 30.0 };
                    let view = camera.fit(corners(), aspect, 0.1);
                    let places: Vec<Vec3> = corners().map(|p| view.clip.project_point3(p)).collect();
                    let reach = places.iter().map(|p| p.x.abs().max(p.y.abs())).fold(0.0, f32::max);
                    assert!(reach > 0.75 && reach < 0.95, "{camera:?} {aspect}: {reach}");
                    assert!(places.iter().all(|p| (0.0..=1.0).contains(&p.z)), "{camera:?} {aspect}: {places:?}");
                }
            }
        }
    }

    #[test]
    fn up_is_up_and_the_left_of_the_face_is_to_the_right_of_the_picture() {
        let view = Camera::default().fit(corners(), 1.0, 0.1);
        let at = |p: Vec3| view.clip.project_point3(p);
        let middle = view.ball.0;
        assert!(at(middle + Vec3::Y).y < at(middle).y && at(middle + Vec3::X).x > at(middle).x);
        assert!(at(middle + Vec3::Z).z < at(middle).z);
        let from_left = Camera { yaw: 90.0, ..Camera::default() }.fit(corners(), 1.0, 0.1);
        assert!(from_left.eye.x > 3.0 && (from_left.eye.z - middle.z).abs() < 1e-3);
    }

    #[test]
    fn nothing_to_see_is_no_reason_to_fail() {
        let view = Camera::default().fit(std::iter::empty(), 1.0, 0.1);
        assert!(view.clip.is_finite() && view.eye.is_finite());
        let point = Camera::default().fit(std::iter::once(Vec3::ONE), 1.0, 0.1);
        assert!(point.clip.is_finite() && point.clip.project_point3(Vec3::ONE).is_finite());
    }
}
