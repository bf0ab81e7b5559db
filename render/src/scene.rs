//! What the shaders are told: of the light and the camera, of each head, and of each part of a mesh.

use crate::camera::{View, direction};
use bytemuck::{Pod, Zeroable};
use deltamorph::ash::vk;
use deltamorph::{PoseView, StreamView};
use glam::{Mat4, Vec3, Vec4};

/// What is shown of a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Show {
    /// Skin, eyes and teeth.
    #[default]
    Shaded,
    /// A checker of so many squares from side to side of the texture, through the texture coordinates.
    Checker(f32),
    /// How far each vertex is from the base pose, in input units; the number is the end of the scale.
    Distance(f32),
    /// [`Model::set_values`](crate::Model::set_values); the number is the end of the scale.
    Values(f32),
    /// Normals as colours.
    Normals,
    /// The edges of faces, those in front: triangles that faces of more corners are drawn as do not show.
    Wire,
    /// How far each vertex has come from the previous pose ([`Head::previous`]), in input units; the number is the end of the
    /// scale.
    Motion(f32),
    /// What updates have changed glows, and goes out ([`Target::set_glow`](crate::Target::set_glow)).
    Blocks,
    /// As shaded, with wrinkles where the skin is compressed, by the masks of each head ([`Head::masks`]).
    Wrinkles,
}

/// The lights: a key light that casts shadows, a fill light on the other side, a rim light from behind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Degrees from the camera to the key light, to the right.
    pub yaw: f32,
    /// Degrees up.
    pub pitch: f32,
    /// How bright the key light is; the others follow. 1 is usual, 0 leaves what is around.
    pub strength: f32,
}

impl Default for Light {
    fn default() -> Self {
        Self { yaw: -38.0, pitch: 34.0, strength: 1.0 }
    }
}

/// Heads are drawn as a camera sees them, in a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scene {
    /// The camera.
    pub view: View,
    /// The lights.
    pub light: Light,
    /// What is shown.
    pub show: Show,
}

/// A head to draw.
#[derive(Clone, Copy, Debug)]
pub struct Head {
    /// The buffer that its pose is in, as a vertex buffer.
    pub buffer: vk::Buffer,
    /// Where the pose begins there, in bytes.
    pub offset: u64,
    /// [`PoseView::units`]; 1 of float32 poses.
    pub units: [f32; 2],
    /// Where it stands: turned, moved and scaled by one factor.
    pub place: Mat4,
    /// The buffer that its previous pose is in, and where it begins there: for [`Show::Motion`].
    pub previous: (vk::Buffer, u64),
    /// The wrinkle masks of the pose: for [`Show::Wrinkles`].
    pub masks: Option<Masks>,
}

/// The wrinkle masks of a head's pose, which the engine sums as any stream of the mesh ([`wrinkles::add`](crate::wrinkles::add)).
#[derive(Clone, Copy, Debug)]
pub struct Masks {
    /// The buffer that they are in, as a vertex buffer: as far apart as vertices of the pose, and stored as these are.
    pub buffer: vk::Buffer,
    /// Where the first begins there, in bytes.
    pub offset: u64,
    /// What an integer of each is; 1 of float32 poses.
    pub units: [f32; 2],
}

impl Masks {
    /// As [`Crowd::stream`](deltamorph::Crowd::stream) has them.
    pub fn new(stream: &StreamView) -> Self {
        Self { buffer: stream.buffer, offset: stream.offset, units: [stream.units[0], stream.units[1]] }
    }
}

impl Head {
    /// A head of a crowd's, which does not move.
    pub fn new(pose: &PoseView, place: Mat4) -> Self {
        let (buffer, offset, units) = (pose.buffer, pose.offset, pose.units);
        Self { buffer, offset, units, place, previous: (buffer, offset), masks: None }
    }

    /// That comes from `pose`, as [`Crowd::previous_pose`](deltamorph::Crowd::previous_pose) has it; without one it does not
    /// move.
    #[must_use]
    pub fn previous(mut self, pose: Option<&PoseView>) -> Self {
        self.previous = pose.map_or((self.buffer, self.offset), |pose| (pose.buffer, pose.offset));
        self
    }

    /// With wrinkle masks.
    #[must_use]
    pub fn masks(mut self, masks: Option<Masks>) -> Self {
        self.masks = masks;
        self
    }
}

/// `Scene` in glsl/scene.glsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub(crate) struct HeadScene {
    clip: Mat4,
    shadow: Mat4,
    eye: Vec4,
    key: Vec4,
    fill: Vec4,
    rim: Vec4,
    middle: Vec4,
    show: Vec4,
}

/// `Part` in glsl/scene.glsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub(crate) struct PartPush {
    pub(crate) ball: [f32; 4],
    pub(crate) units: [f32; 2],
    pub(crate) mask_units: [f32; 2],
    pub(crate) material: u32,
    /// Of the head, in `told`.
    pub(crate) first_told: u32,
    pub(crate) block: u32,
}

impl Scene {
    /// Of a head that `place` puts into the scene; `middle` of what is drawn, and how far it reaches. `texel`: the size of one
    /// of the shadow map, where there is a map.
    pub(crate) fn head(&self, place: &Mat4, middle: Vec4, texel: f32) -> HeadScene {
        let View { clip, eye, axes, ball: (centre, radius) } = self.view;
        let Light { yaw, pitch, strength } = self.light;
        let back = place.inverse();
        // Lights are far away: directions, of unit length in the head's space as well.
        let towards =
            |to: Vec3, bright: f32| back.transform_vector3(to).normalize_or(Vec3::Z).extend(bright * strength);
        let key = direction(axes, yaw, pitch);
        let (show, end) = match self.show {
            Show::Shaded => (0.0, 1.0),
            Show::Checker(_) => (1.0, 1.0),
            Show::Distance(end) => (2.0, end),
            Show::Values(end) => (3.0, end),
            Show::Normals => (4.0, 1.0),
            Show::Wire => (5.0, 1.0),
            Show::Motion(end) => (6.0, end),
            Show::Blocks => (7.0, 1.0),
            Show::Wrinkles => (8.0, 1.0),
        };
        let squares = if let Show::Checker(squares) = self.show { squares } else { 0.0 };
        HeadScene {
            clip: clip * place,
            shadow: shadow(key, centre, radius) * place,
            eye: back.transform_point3(eye).extend(texel),
            key: towards(key, 1.45),
            fill: towards(direction(axes, -1.4 * yaw, pitch * 0.1), 0.36),
            rim: towards(direction(axes, 150.0 * -yaw.signum(), 35.0), 0.8),
            middle,
            show: Vec4::new(show, end.max(f32::MIN_POSITIVE), squares, 0.0),
        }
    }
}

/// To the shadow map of a light in the direction `key`: x and y from 0 to 1, and depth, of a ball and what poses add to it.
fn shadow(key: Vec3, centre: Vec3, radius: f32) -> Mat4 {
    let right = key.any_orthonormal_vector();
    let (up, reach) = (key.cross(right), 1.0 / (2.4 * radius));
    let row = |axis: Vec3| (axis * reach).extend(0.5 - axis.dot(centre) * reach);
    Mat4::from_cols(row(right), row(up), row(-key), Vec4::W).transpose()
}

/// The colour of a value from 0 to the end of the scale (1), in sRGB: `heat` in glsl/heat.glsl.
pub fn heat(value: f32) -> [u8; 3] {
    const STOPS: [[f32; 3]; 6] = [
        [0.10, 0.10, 0.11],
        [0.03, 0.10, 0.45],
        [0.02, 0.38, 0.42],
        [0.12, 0.50, 0.06],
        [0.80, 0.52, 0.02],
        [0.72, 0.03, 0.02],
    ];
    let at = value.clamp(0.0, 1.0) * 5.0;
    let i = (at as usize).min(4);
    let (low, high) = (Vec3::from(STOPS[i]), Vec3::from(STOPS[i + 1]));
    let encoded =
        |linear: f32| if linear < 0.0031308 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
    low.lerp(high, at - i as f32).to_array().map(|linear| (encoded(linear) * 255.0).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shadow_map_holds_the_ball() {
        let (key, centre) = (Vec3::new(0.3, 0.6, 0.74).normalize(), Vec3::new(3.0, -2.0, 9.0));
        let to_map = shadow(key, centre, 5.0);
        for axis in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, key, -key] {
            let place = to_map.project_point3(centre + axis * 5.0);
            assert!((place - 0.5).abs().max_element() < 0.5, "{place}");
        }
        // Nearer to the light is nearer to 0.
        assert!(to_map.project_point3(centre + key).z < to_map.project_point3(centre).z);
    }

    #[test]
    fn structures_are_those_of_the_shaders() {
        use spirq::prelude::*;
        use std::mem::offset_of;
        let words: Vec<u32> = crate::modules::FRAGMENT.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect();
        let entries = ReflectConfig::new().spv(words).ref_all_rscs(true).reflect().expect("a module");
        let offsets = |find: &dyn Fn(&Variable) -> bool| -> Vec<usize> {
            let found = entries[0].vars.iter().find(|variable| find(variable)).expect("a block");
            let members = &found.ty().as_struct().expect("a block").members;
            members.iter().map(|member| member.offset.expect("an offset")).collect()
        };
        let scene = offsets(&|v| matches!(v, Variable::Descriptor { desc_bind, .. } if desc_bind.bind() == 0));
        let expected = [
            offset_of!(HeadScene, clip),
            offset_of!(HeadScene, shadow),
            offset_of!(HeadScene, eye),
            offset_of!(HeadScene, key),
            offset_of!(HeadScene, fill),
            offset_of!(HeadScene, rim),
            offset_of!(HeadScene, middle),
            offset_of!(HeadScene, show),
        ];
        assert_eq!(scene, expected);
        let part = offsets(&|v| matches!(v, Variable::PushConstant { .. }));
        let expected = [
            offset_of!(PartPush, ball),
            offset_of!(PartPush, units),
            offset_of!(PartPush, mask_units),
            offset_of!(PartPush, material),
            offset_of!(PartPush, first_told),
            offset_of!(PartPush, block),
        ];
        assert_eq!(part, expected);
    }
}
