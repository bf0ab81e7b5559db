use super::texels::DeltaTexels;
use crate::testing;
use deltamorph::internals::pack::{DeltaFormat, POSE_FLOATS, PackDesc, PackedMesh};

const SIDE: u32 = 8192;

fn packed(targets: usize, format: DeltaFormat) -> PackedMesh {
    PackedMesh::pack(&testing::mesh(1000, targets), &PackDesc::new(format)).expect("a mesh")
}

/// Loads the number at a texel of a texture as a shader does.
fn load(bytes: &[u8], format: DeltaFormat, texel: u32, component: usize) -> f64 {
    let at = texel as usize * 4 + component;
    match format {
        DeltaFormat::Snorm16 => i16::from_le_bytes([bytes[2 * at], bytes[2 * at + 1]]).into(),
        _ => f32::from_le_bytes(std::array::from_fn(|byte| bytes[4 * at + byte])).into(),
    }
}

#[test]
fn textures_hold_the_deltas_of_each_target_where_its_rectangles_are() {
    for format in DeltaFormat::DENSE {
        let mesh = packed(37, format);
        let baked = DeltaTexels::bake(&mesh.groups()[0], SIDE).expect("textures");
        let images = [false, true].map(|normals| baked.bytes(normals));
        let stride = if format == DeltaFormat::Snorm16 { 8 } else { 16 };
        assert_eq!(images[0].len() as u32, baked.image[0] * baked.image[1] * stride);
        let width = baked.size[0];
        for (t, target) in mesh.layout().targets.iter().enumerate() {
            let mut drawn = vec![[0.0; POSE_FLOATS]; (baked.size[0] * baked.size[1]) as usize];
            for r in &baked.rectangles[baked.first[t] as usize..baked.first[t + 1] as usize] {
                assert!(r.x + r.width <= baked.size[0] && r.y + r.height <= baked.size[1], "{r:?}");
                for (x, y) in (0..r.height).flat_map(|y| (0..r.width).map(move |x| (x, y))) {
                    let (from, to) = (r.first + y * r.width + x, (r.y + y) * width + r.x + x);
                    for (c, drawn) in drawn[to as usize].iter_mut().enumerate() {
                        assert_eq!(*drawn, 0.0, "drawn once");
                        let step = if c < 3 { target.position_step } else { target.normal_step() };
                        *drawn = load(&images[c / 3], format, from, c % 3) * f64::from(step);
                    }
                }
            }
            let mut expected = vec![[0.0; POSE_FLOATS]; baked.texels.len()];
            mesh.for_each_delta(t, |vertex, delta| expected[vertex] = delta);
            for (vertex, expected) in expected.iter().enumerate() {
                assert_eq!(drawn[baked.texels[vertex] as usize], *expected, "{format:?} target {t} vertex {vertex}");
            }
            assert_eq!(drawn[0], [0.0; POSE_FLOATS], "vertices that nothing moves");
        }
    }
}

#[test]
fn what_does_not_fit_is_refused() {
    let text = DeltaTexels::bake(&packed(37, DeltaFormat::Float32).groups()[0], 16).expect_err("too small").to_string();
    assert!(text.contains("16 × 16") && text.contains("split the mesh"), "{text}");
}
