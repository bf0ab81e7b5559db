//! How a glTF file stores numbers.

use clap::ValueEnum;
use deltamorph::import::gltf::GlbEncoding;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Encoding {
    /// 32-bit floats, sparse where that takes less: every program reads them, and nothing is rounded
    #[default]
    Float,
    /// Integers of 8 and 16 bits (KHR_mesh_quantization), within --position-error and --normal-error
    Quantized,
    /// Quantised and compressed (EXT_meshopt_compression), in an order of vertices that compresses well
    Meshopt,
}

impl From<Encoding> for GlbEncoding {
    fn from(encoding: Encoding) -> Self {
        match encoding {
            Encoding::Float => Self::Float,
            Encoding::Quantized => Self::Quantized,
            Encoding::Meshopt => Self::Meshopt,
        }
    }
}
