//! The steps after the pose: the one list of them, which build.rs, the library and the tests share.
//!
//! A new step is an item of `after_steps!`, src/after/MODULE (its target, and what it does for an instance), and its
//! kernels in glsl/. Plain data without dependencies, since build.rs includes this file.

/// Expand a macro with arguments and the list, in the order in which steps are recorded.
///
/// An item is the documentation of the engine's function that sets a target; the name of the step, its module in
/// `after` with the type that is made for an instance, and what of the module is public; that function, and a target as
/// it takes it; and the step's dispatches, one after the other. A dispatch is what it reads, and the `Resource` that it
/// writes, the last one for the host; its push constants, a structure that its shader explains; and the fields of its
/// kernels' rows that are not those of any compute shader. Targets are made for one of the kernels.
macro_rules! after_steps {
    ($expanded:ident $arguments:tt) => {
        $expanded! { $arguments
            /// Have positions of an instance written as float32 into a buffer of the host's own, from the next recorded
            /// update on: for ray tracing, picking, or a shader that cannot decode poses.
            ///
            /// For builds of acceleration structures name
            /// [`ACCELERATION_STRUCTURES`](crate::Consumers::ACCELERATION_STRUCTURES) among the consumers.
            Decode decode::Decode [DecodeTarget] (set_decode_target: &DecodeTarget) {
                [Asset, Poses] => Decoded,
                DecodePush {
                    pose_at: u32, base_at: u32, decoded_at: u32, stride: u32, normal_at: u32, vertices: u32, count: u32,
                    listed: u32, units: [f32; TRIPLES],
                }
                // Poses of an instance, base pose, pieces, destination.
                [{
                    name: "decode",
                    poses: true,
                    bindings: &[(0, WORDS), (1, WORDS), (2, WORDS), (3, WORDS)],
                    places: true
                }];
            }

            /// Have an instance skinned into a buffer of the host's own, from the next recorded update on, from poses
            /// of any format and of either kind of crowd.
            ///
            /// Where joints moved ([`Crowd::set_joints`](crate::Crowd::set_joints)), all vertices are written. The
            /// caller is responsible for joints that are written, and visible to reads of compute shaders, when an
            /// update runs that skins.
            ///
            /// Refused besides: a skin of another engine or mesh, or of a mesh packed otherwise; joints that reach
            /// beyond their buffer; more pieces of 32 vertices than the device's texel buffers have room for (on any
            /// device 65,536).
            Skin skin::Skin [GpuSkin, SkinDesc, SkinMethod, SkinTarget, SkinnedView]
                (set_skin_target: (&GpuSkin, &SkinTarget))
            {
                [Poses] => Skinned,
                SkinPush {
                    pose_at: u32, skin_at: u32, joints_at: u32, skinned_at: u32, stride: u32, normal_at: u32, vertices: u32,
                    count: u32, listed: u32,
                    // Vectors of two begin at a multiple of 8 bytes.
                    padding: u32,
                    units: [f32; TRIPLES],
                }
                // By matrices, and by dual quaternions. Poses of an instance, base pose and influences, joints,
                // destination, pieces: there is no storage buffer left for these, which are texels. A specialization
                // constant: influences of a vertex.
                [{
                    name: "skin",
                    poses: true,
                    bindings: &[(0, WORDS), (1, WORDS), (2, Buffer::Storage(16)), (3, WORDS), (4, WORD_LIST)],
                    constants: 1,
                    places: true
                }, {
                    name: "skin",
                    suffix: "dual",
                    defines: &["DUAL"],
                    poses: true,
                    bindings: &[(0, WORDS), (1, WORDS), (2, Buffer::Storage(16)), (3, WORDS), (4, WORD_LIST)],
                    constants: 1,
                    places: true
                }];
            }

            /// Have the normals of an instance's pose computed from its morphed surface, into a buffer of the host's
            /// own, from the next recorded update on: area-weighted, as on import, welded vertices alike, with unit
            /// length.
            ///
            /// A vertex whose triangles have no area has its normal of the base pose. Pieces of 32 vertices that share
            /// a triangle with those that the update changed are written as well.
            ///
            /// Refused besides: a surface of another engine or mesh, or of a mesh packed otherwise.
            Normals normals::Recomputed [GpuNormals, NormalsDesc, NormalsTarget]
                (set_normals_target: (&GpuNormals, &NormalsTarget))
            {
                [Poses] => Normals,
                NormalsPush {
                    pose_at: u32, fans_at: u32, normals_at: u32, stride: u32, vertices: u32, count: u32, listed: u32,
                    // Vectors of two begin at a multiple of 8 bytes.
                    padding: u32,
                    units: [f32; TRIPLES],
                }
                // Poses of an instance, base pose and fans, pieces, destination.
                [{
                    name: "normals",
                    poses: true,
                    bindings: &[(0, WORDS), (1, WORDS), (2, WORDS), (3, WORDS)],
                    places: true
                }];
            }

            /// Have the bounds of an instance's pose written into a buffer of the host's own, from the next recorded
            /// update on: the least and greatest coordinates of all its vertices, exactly those of the pose as it is
            /// decoded.
            ///
            /// They are of the morphed pose: a skinned one has others. The parts of 256 vertices that the update
            /// changed have their bounds found, then one workgroup those of all parts together. It takes 24 bytes of
            /// device memory for each part. Without a GPU: [`WeightBounds`](crate::after::WeightBounds).
            Bounds bounds::TightBounds [Bounds, BoundsTarget, WeightBounds] (set_bounds_target: &BoundsTarget) {
                [Asset, Poses] => BoundsOfParts,
                BoundsPush { pose_at: u32, base_at: u32, vertices: u32, listed: u32, units: [f32; TRIPLES], }
                // Poses of an instance, base pose, pieces, parts.
                [{
                    name: "bounds",
                    poses: true,
                    bindings: &[(0, WORDS), (1, WORDS), (2, WORDS), (3, WORDS)],
                    places: true
                }];

                [BoundsOfParts] => Bounds,
                BoundsTotalPush { count: u32, bounds_at: u32, }
                // Parts, destination.
                [{ name: "bounds_total", bindings: &[(0, WORDS), (1, WORDS)] }];
            }
        }
    };
}
pub(crate) use after_steps;
