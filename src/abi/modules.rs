//! The SPIR-V modules that build.rs embeds: a `static` for each row of [`KERNELS`].

use super::formats::{FORMATS, FormatRow, POSE_FORMATS};
use super::kernels::{KERNELS, KernelRow};
use crate::error::{Error, Result};
use crate::pack::{DeltaFormat, PoseFormat};
use std::ops::Range;

include!(concat!(env!("OUT_DIR"), "/modules.rs"));

/// What the modules were made from: compiler, sources, outputs.
pub const MANIFEST: &str = include_str!(concat!(env!("OUT_DIR"), "/manifest.txt"));

/// A module.
#[derive(Debug, PartialEq)]
pub struct Module {
    /// Its name under spirv/.
    pub name: &'static str,
    /// What it declares.
    pub kernel: &'static KernelRow,
    /// The format whose deltas it reads.
    pub format: Option<&'static FormatRow>,
    /// Targets that are vertex attributes.
    pub batch: u32,
    /// The modules of the kernel, compressed (LZ4): SPIR-V words, each in as few bytes as it needs, seven bits to a byte, the
    /// lowest first.
    pub modules: &'static [u8],
    /// Those of this one, when it is decompressed.
    pub bytes: Range<usize>,
}

impl Module {
    /// The SPIR-V.
    pub fn words(&self) -> Vec<u32> {
        // What build.rs compressed decompresses, which tests/spirv.rs shows of every module.
        let modules = lz4_flex::block::decompress_size_prepended(self.modules).unwrap_or_default();
        let code = modules.get(self.bytes.clone()).unwrap_or_default();
        let mut words = Vec::with_capacity(code.len());
        let (mut word, mut shift) = (0, 0);
        for byte in code {
            word |= u32::from(byte & 0x7f) << shift;
            shift += 7;
            if byte & 0x80 == 0 {
                words.push(word);
                (word, shift) = (0, 0);
            }
        }
        words
    }
}

/// A kernel's modules: for each pair of formats that it takes one, or one for each number of targets.
#[derive(Debug, PartialEq)]
pub struct Kernel {
    /// What they declare.
    pub row: &'static KernelRow,
    /// By format of poses and of deltas: the first in [`MODULES`], and how many.
    modules: [[(usize, usize); FORMATS.len()]; POSE_FORMATS.len()],
}

impl Kernel {
    /// All modules for a pair of formats; none if it does not take them, or the library was built without the technique.
    pub fn modules(&self, format: DeltaFormat, pose: PoseFormat) -> &'static [Module] {
        let (first, count) = self.modules[pose as usize][format as usize];
        MODULES.get(first..first + count).unwrap_or_default()
    }

    /// The module for a pair of formats and, where they are vertex attributes, `batch` targets.
    ///
    /// # Errors
    /// There is none.
    pub fn module(&self, format: DeltaFormat, pose: PoseFormat, batch: u32) -> Result<&'static Module> {
        self.modules(format, pose).get(batch as usize).ok_or_else(|| {
            let (source, deltas, poses) = (self.row.source(), format.name(), pose.row().file);
            Error::invalid(
                format!("no kernel {source} for {deltas} deltas, {poses} poses and a batch of {batch}"),
                match self.row.baseline {
                    true => "build deltamorph with the feature 'baselines', or use another update path",
                    false => "use another format, update path or batch size",
                },
            )
        })
    }
}
