//! How poses are stored: a file for each format, here and under `glsl/poses/`, and one list of them,
//! `src/abi/formats.rs`. The base pose of a mesh is float32 in all of them.

use super::POSE_FLOATS;
use crate::abi::formats::{POSE_FORMATS, PoseRow, pose_formats};

/// The files of the formats, and their names.
macro_rules! declared {
    (() $($(#[$meta:meta])* $name:ident $file:ident $row:tt)*) => {
        $(mod $file;)*

        /// How the six numbers of a vertex (of positions and normals: position, then normal) are stored in pose buffers.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
        #[non_exhaustive]
        pub enum PoseFormat {
            $($(#[$meta])* $name,)*
        }

        impl PoseFormat {
            /// Every format.
            pub const ALL: [Self; POSE_FORMATS.len()] = [$(Self::$name),*];

            fn storage(self) -> &'static dyn PoseStorage {
                match self {
                    $(Self::$name => &$file::$name,)*
                }
            }
        }
    };
}
pose_formats!(declared());

/// What the file of a format has.
trait PoseStorage {
    /// The numbers of a vertex, from its bytes.
    fn decode(&self, vertex: &[u8]) -> [f32; POSE_FLOATS];

    /// Bytes before a component of a vertex.
    fn offset(&self, component: usize) -> usize;
}

impl PoseFormat {
    /// What build.rs and the tests know of it, too.
    pub(crate) const fn row(self) -> &'static PoseRow {
        &POSE_FORMATS[self as usize]
    }

    /// Bytes of a vertex.
    pub const fn stride(self) -> usize {
        self.row().stride as usize
    }

    /// Bytes from the beginning of a vertex to a component.
    pub(crate) fn offset(self, component: usize) -> usize {
        self.storage().offset(component)
    }

    /// The numbers of a pose that was read back: [`POSE_FLOATS`] for each vertex.
    pub fn decode(self, pose: &[u8]) -> Vec<f32> {
        pose.chunks_exact(self.stride()).flat_map(|vertex| self.storage().decode(vertex)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pack::VERTEX_PADDING;

    #[test]
    fn poses_begin_where_descriptors_may_and_attributes_lie_in_their_vertex() {
        for format in PoseFormat::ALL {
            assert_eq!(POSE_FORMATS.iter().filter(|row| row.file == format.row().file).count(), 1);
            assert_eq!(format.stride() * VERTEX_PADDING % 256, 0, "{format:?}");
            assert!(format.row().attributes.iter().all(|(_, offset)| (*offset as usize) < format.stride()));
            assert!((0..POSE_FLOATS).all(|component| format.offset(component) < format.stride()), "{format:?}");
        }
    }

    #[test]
    fn float32_is_six_floats() {
        let pose: Vec<f32> = (0..12).map(|i| i as f32 - 0.5).collect();
        assert_eq!(PoseFormat::Float32.decode(bytemuck::cast_slice(&pose)), pose);
        assert_eq!(PoseFormat::Float32.offset(3), 12);
    }
}
