//! The SPIR-V modules that build.rs embeds: a `static` for each row of [`KERNELS`].

use super::formats::{FORMATS, FormatRow, POSE_FORMATS, PoseRow};
use super::kernels::{KERNELS, KernelRow};
use crate::error::{Error, Result};
use lzma_rust2::LzmaReader;
use std::io::Read as _;
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
    /// The modules of the kernel, as a `.lzma` file: little-endian words.
    pub modules: &'static [u8],
    /// Those of this one, when it is decompressed.
    pub bytes: Range<usize>,
}

impl Module {
    /// The SPIR-V.
    pub fn words(&self) -> Vec<u32> {
        let Range { start, end } = self.bytes;
        let mut modules = vec![0; end];
        // What follows does not have to be decompressed. What build.rs compressed can be, which tests/project/spirv.rs
        // shows of every module.
        let read =
            LzmaReader::new_mem_limit(self.modules, u32::MAX, None).and_then(|mut all| all.read_exact(&mut modules));
        let code = if read.is_ok() { &modules[start..] } else { &[] };
        code.chunks_exact(4).map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]])).collect()
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
    /// All modules for a pair of formats, of which a kernel that reads no deltas takes any; none if it does not take
    /// them, or the library was built without the technique.
    pub fn modules(&self, format: &FormatRow, pose: &PoseRow) -> &'static [Module] {
        let formats = FORMATS.iter().position(|row| row == format).zip(POSE_FORMATS.iter().position(|row| row == pose));
        let modules = formats.and_then(|(format, pose)| {
            let (first, count) = self.modules[pose][format];
            MODULES.get(first..first + count)
        });
        modules.unwrap_or_default()
    }

    /// The module for a pair of formats and, where they are vertex attributes, `batch` targets.
    ///
    /// # Errors
    /// There is none.
    pub fn module(&self, format: &FormatRow, pose: &PoseRow, batch: u32) -> Result<&'static Module> {
        self.modules(format, pose).get(batch as usize).ok_or_else(|| {
            let (source, deltas, poses) = (self.row.source(), format.name, pose.file);
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
