//! Shader data: the light and the camera, each head, and each part of a mesh.

use crate::camera::{View, direction};
use bytemuck::{Pod, Zeroable};
use deltamorph::ash::vk;
use deltamorph::{Bounds, POSE_FLOATS};
use glam::{Mat4, Vec3, Vec4};

/// The appearance of a surface. The order is that of the numbers in glsl/scene.glsl.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Show {
    /// Skin, eyes and teeth.
    #[default]
    Shaded,
    /// Distance of each vertex from the base pose, up to [`Scene::end`].
    Heat,
    /// Normals as colours.
    Normals,
    /// The visible edges of faces, without the diagonals of faces that have more than three corners.
    Wire,
    /// Distance of each vertex from the previous pose (`Head::previous`), up to [`Scene::end`].
    Motion,
    /// Vertices that updates have changed glow, and fade (`Target::set_glow`).
    Blocks,
    /// Like [`Self::Shaded`], with wrinkles where the skin is compressed, from each head's masks (`Head::masks`).
    Wrinkles,
}

/// The lights: a key light that casts shadows, a fill light on the other side, a rim light from behind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Degrees to the right, from the camera to the key light.
    pub yaw: f32,
    /// Degrees upwards, from the camera to the key light.
    pub pitch: f32,
}

impl Default for Light {
    fn default() -> Self {
        Self { yaw: -38.0, pitch: 34.0 }
    }
}

/// The view, the light and the appearance of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scene {
    /// The camera.
    pub view: View,
    /// The lights.
    pub light: Light,
    /// The appearance of surfaces.
    pub show: Show,
    /// End of the scale of colours that stand for lengths, in input units.
    pub end: f32,
}

/// A head to draw.
#[derive(Clone, Copy)]
pub struct Head {
    /// The buffer with its pose, as a vertex buffer.
    pub buffer: vk::Buffer,
    /// Offset of the pose in the buffer, in bytes.
    pub offset: u64,
    /// What its attributes stand for.
    pub scale: Scale,
    /// Its transform: rotation, translation and a uniform scale.
    pub place: Mat4,
    /// The buffer with its previous pose, or its pose if it does not move, and the offset there: for [`Show::Motion`].
    pub previous: (vk::Buffer, u64),
    /// The wrinkle masks of the pose: for [`Show::Wrinkles`].
    pub masks: Option<Masks>,
    /// Bounds of the pose, for culling; `None`: it is always drawn.
    pub bounds: Option<Bounds>,
}

/// The wrinkle masks of a head's pose. The engine sums them like any stream of the mesh
/// ([`wrinkles::add`](crate::wrinkles::add)).
#[derive(Clone, Copy)]
pub struct Masks {
    /// The buffer with the masks, as a vertex buffer, with the stride and number format of the pose.
    pub buffer: vk::Buffer,
    /// Offset of the first mask in the buffer, in bytes.
    pub offset: u64,
    /// The values of the masks' numbers, and of number 0.
    pub scale: [f32; 4],
}

/// Values of vertex attributes: offset + attribute × scale ([`PoseView::units`](deltamorph::PoseView::units)).
#[derive(Clone, Copy)]
pub struct Scale {
    pub scale: [f32; POSE_FLOATS],
    pub offsets: [f32; POSE_FLOATS],
}

impl Scale {
    /// Of floats.
    pub const ONE: Self = Self { scale: [1.0; POSE_FLOATS], offsets: [0.0; POSE_FLOATS] };

    /// Of two components from `first` on.
    pub fn of_masks(&self, first: usize) -> [f32; 4] {
        [self.scale[first], self.scale[first + 1], self.offsets[first], self.offsets[first + 1]]
    }
}

/// The block `Scene` of glsl/scene.glsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct HeadScene {
    pub clip: Mat4,
    /// Maps x and y to 0..1 instead of −1..1.
    pub shadow: Mat4,
    eye: Vec4,
    key: Vec4,
    fill: Vec4,
    rim: Vec4,
    middle: Vec4,
    show: Vec4,
}

/// The block `Part` of glsl/scene.glsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct PartPush {
    pub ball: [f32; 4],
    pub colour: [f32; 4],
    pub scale: [f32; 4],
    pub offset: [f32; 4],
    pub mask_scale: [f32; 4],
    pub material: u32,
    /// Index of the head's first number in `told`; the largest number: there are none.
    pub first_told: u32,
    pub block: u32,
    pub unused: u32,
}

impl Scene {
    /// Returns the shader data of a head with the transform `place`; `middle` has the middle and the radius of the
    /// drawn geometry. `texel`: the size of a texel of the shadow map.
    pub(crate) fn head(&self, place: &Mat4, middle: Vec4, texel: f32) -> HeadScene {
        let View { clip, eye, axes, ball: (centre, radius) } = self.view;
        let Light { yaw, pitch } = self.light;
        let back = place.inverse();
        // Lights are far away: they are unit directions, also in the head's space.
        let towards = |to: Vec3, bright: f32| back.transform_vector3(to).normalize_or(Vec3::Z).extend(bright);
        let key = direction(axes, yaw, pitch);
        HeadScene {
            clip: clip * place,
            shadow: shadow(key, centre, radius) * place,
            eye: back.transform_point3(eye).extend(texel),
            key: towards(key, 1.45),
            fill: towards(direction(axes, -1.4 * yaw, pitch * 0.1), 0.36),
            rim: towards(direction(axes, 150.0 * -yaw.signum(), 35.0), 0.8),
            middle,
            show: Vec4::new(self.show as u32 as f32, self.end.max(f32::MIN_POSITIVE), 0.0, 0.0),
        }
    }
}

/// Returns the transform to the shadow map of a light in the direction `key` (x, y and depth from 0 to 1), for a ball
/// around the base pose with room for poses.
fn shadow(key: Vec3, centre: Vec3, radius: f32) -> Mat4 {
    let right = key.any_orthonormal_vector();
    let up = key.cross(right);
    let reach = 1.0 / (2.4 * radius);
    let row = |axis: Vec3| (axis * reach).extend(0.5 - axis.dot(centre) * reach);
    Mat4::from_cols(row(right), row(up), row(-key), Vec4::W).transpose()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shadow_map_holds_the_ball() {
        let key = Vec3::new(0.3, 0.6, 0.74).normalize();
        let centre = Vec3::new(3.0, -2.0, 9.0);
        let to_map = shadow(key, centre, 5.0);
        for axis in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, key, -key] {
            let place = to_map.project_point3(centre + axis * 5.0);
            assert!((place - 0.5).abs().max_element() < 0.5, "{place}");
        }
        // Depth decreases towards the light.
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
            offset_of!(PartPush, colour),
            offset_of!(PartPush, scale),
            offset_of!(PartPush, offset),
            offset_of!(PartPush, mask_scale),
            offset_of!(PartPush, material),
            offset_of!(PartPush, first_told),
            offset_of!(PartPush, block),
        ];
        assert_eq!(part, expected);
    }
}
