//! The list of post-morph passes, shared by build.rs, the library and the tests.
//!
//! A step is an item of `after_steps!`, a module in src/after/ (its target and per-instance state) and its kernels in
//! glsl/. build.rs includes this file, so it is plain data without dependencies.

/// Expands a macro with arguments and the list, in recording order.
///
/// An item is the documentation of the engine's setter; the step's name, its module in `after` with its per-instance
/// type, and the module's public names; the setter and its parameter; the `Resource`s that its dispatch reads and the
/// one that it writes for the host; its push constants, described in its shader; and the fields of its kernel rows that
/// differ from a compute shader that reads poses of any format wherever they are. A target uses one of the kernels.
macro_rules! after_steps {
    ($expanded:ident $arguments:tt) => {
        $expanded! { $arguments
            /// Writes the positions of an instance as float32 into an output buffer of the host, from the next recorded
            /// update on: for ray tracing, picking, or shaders that cannot decode poses.
            ///
            /// To build acceleration structures from it, add
            /// [`ACCELERATION_STRUCTURES`](crate::Consumers::ACCELERATION_STRUCTURES) to the consumers.
            Decode decode::Decode [DecodeTarget] (set_decode_target: &DecodeTarget) {
                [Poses] => Decoded,
                DecodePush {
                    units: [f32; 4], offset: [f32; 4], pose_at: u32, decoded_at: u32, stride: u32, normal_at: u32,
                    vertices: u32, count: u32, listed: u32,
                    // A multiple of 16 bytes.
                    padding: u32,
                }
                // Poses of an instance, pieces, destination.
                [{
                    name: "decode",
                    bindings: &[(0, WORDS), (1, WORDS), (2, WORDS)]
                }]
            }

            /// Skins an instance into an output buffer of the host, from the next recorded update on, for any pose
            /// format and both kinds of crowd.
            ///
            /// All vertices are written after joints moved ([`Crowd::set_joints`](crate::Crowd::set_joints)). When an
            /// update that skins runs, the joints must have been written, and be visible to compute shader reads.
            ///
            /// Further errors: a skin of another engine or mesh, or of another packing of the mesh; joints beyond the
            /// end of their buffer; more pieces of 32 vertices than a texel buffer of the device holds (65,536 on any
            /// device).
            Skin skin::Skin [GpuSkin, SkinDesc, SkinMethod, SkinTarget, SkinnedView]
                (set_skin_target: (&GpuSkin, &SkinTarget))
            {
                [Poses] => Skinned,
                SkinPush {
                    units: [f32; 4], offset: [f32; 4], pose_at: u32, joints_at: u32, skinned_at: u32, stride: u32,
                    normal_at: u32, vertices: u32, count: u32, listed: u32,
                }
                // By matrices, and by dual quaternions. Poses of an instance, influences, joints, destination, pieces.
                // Pieces are texels, since no storage buffer is left. Specialization constant: influences per vertex.
                [{
                    name: "skin",
                    bindings: &[(0, WORDS), (1, WORDS), (2, Buffer::Storage(16)), (3, WORDS), (4, WORD_LIST)],
                    constants: 1
                }, {
                    name: "skin",
                    suffix: "dual",
                    defines: &["DUAL"],
                    bindings: &[(0, WORDS), (1, WORDS), (2, Buffer::Storage(16)), (3, WORDS), (4, WORD_LIST)],
                    constants: 1
                }]
            }

            /// Computes the normals of an instance's pose from its morphed surface into an output buffer of the host,
            /// from the next recorded update on: area-weighted as on import, equal for welded vertices, of unit length.
            ///
            /// A vertex whose triangles all have zero area gets its base normal. Pieces of 32 vertices that share a
            /// triangle with changed ones are written too.
            ///
            /// Further errors: a surface of another engine or mesh, or of another packing of the mesh.
            Normals normals::Recomputed [GpuNormals, NormalsDesc, NormalsTarget]
                (set_normals_target: (&GpuNormals, &NormalsTarget))
            {
                [Poses] => Normals,
                NormalsPush {
                    units: [f32; 4], offset: [f32; 4], pose_at: u32, fans_at: u32, normals_at: u32, stride: u32,
                    vertices: u32, count: u32, listed: u32,
                    // A multiple of 16 bytes.
                    padding: u32,
                }
                // Poses of an instance, base pose and fans, pieces, destination.
                [{
                    name: "normals",
                    bindings: &[(0, WORDS), (1, WORDS), (2, WORDS), (3, WORDS)]
                }]
            }
        }
    };
}
pub(crate) use after_steps;
