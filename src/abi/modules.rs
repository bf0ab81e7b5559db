//! The SPIR-V modules embedded by build.rs: a `static` for each row of [`KERNELS`].

use super::formats::{FORMATS, FormatRow, POSE_FORMATS, PoseRow};
use super::ids::from_differences;
use super::kernels::{KERNELS, KernelRow};
use crate::error::{Error, Result};
use lzma_rust2::LzmaReader;
use std::io::Read as _;
use std::ops::Range;

include!(concat!(env!("OUT_DIR"), "/modules.rs"));

/// Compiler, sources and outputs of the modules.
pub const MANIFEST: &str = include_str!(concat!(env!("OUT_DIR"), "/manifest.txt"));

/// The folder of the modules with their debug names.
pub const COMPILED: &str = env!("OUT_DIR");

/// A SPIR-V module.
#[derive(Debug, PartialEq)]
pub struct Module {
    /// Its name under spirv/.
    pub name: &'static str,
    /// The row of its kernel.
    pub kernel: &'static KernelRow,
    /// The delta format; `None` if it reads no deltas.
    pub format: Option<&'static FormatRow>,
    /// Number of targets that are vertex attributes.
    pub batch: u32,
    /// All modules of the kernel, `.lzma`-compressed little-endian words with differences between ids.
    pub modules: &'static [u8],
    /// Its byte range in the decompressed `modules`.
    pub bytes: Range<usize>,
}

impl Module {
    /// The SPIR-V.
    pub fn words(&self) -> Vec<u32> {
        let Range { start, end } = self.bytes;
        let mut modules = vec![0; end];
        // Decompresses up to its end only. Cannot fail on output of build.rs; tests/project/spirv.rs checks every
        // module.
        let read =
            LzmaReader::new_mem_limit(self.modules, u32::MAX, None).and_then(|mut all| all.read_exact(&mut modules));
        let code = if read.is_ok() { &modules[start..] } else { &[] };
        let mut words = code.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect::<Vec<_>>();
        from_differences(&mut words);
        words
    }
}

/// The modules of a kernel, one for each pair of supported formats (and number of targets).
#[derive(Debug, PartialEq)]
pub struct Kernel {
    /// The kernel's row.
    pub row: &'static KernelRow,
    /// By pose format and delta format: first index in [`MODULES`], and count.
    modules: [[(usize, usize); FORMATS.len()]; POSE_FORMATS.len()],
}

impl Kernel {
    /// Its modules for a pair of formats; kernels that read no deltas accept any delta format. Empty if the pair is
    /// unsupported, or the library was built without the technique.
    pub fn modules(&self, format: &FormatRow, pose: &PoseRow) -> &'static [Module] {
        let pose = POSE_FORMATS.iter().position(|row| row.file == pose.modules);
        let formats = FORMATS.iter().position(|row| row == format).zip(pose);
        let modules = formats.and_then(|(format, pose)| {
            let (first, count) = self.modules[pose][format];
            MODULES.get(first..first + count)
        });
        modules.unwrap_or_default()
    }

    /// The module for a pair of formats and `batch` targets as vertex attributes.
    ///
    /// # Errors
    /// No such module.
    pub fn module(&self, format: &FormatRow, pose: &PoseRow, batch: u32) -> Result<&'static Module> {
        self.modules(format, pose).get(batch as usize).ok_or_else(|| {
            let source = self.row.source();
            let formats = format!("{} deltas, {} poses", format.name, pose.file);
            Error::invalid(
                format!("no kernel {source} for {formats} and a batch of {batch}"),
                match self.row.baseline {
                    true => "build deltamorph with the feature 'baselines', or use another update path",
                    false => "use another format, update path or batch size",
                },
            )
        })
    }
}
