//! The checked-in SPIR-V modules: `UPDATE_SPIRV=1 cargo test -p deltamorph-render --test spirv` compiles them from
//! glsl/.

use deltamorph::{Error, PoseFormat, Result};

/// The vertex modules for poses of one format.
pub struct Modules {
    pub face: &'static [u8],
    /// With the previous pose as additional input.
    pub motion: &'static [u8],
    /// With wrinkle masks as additional input.
    pub masks: &'static [u8],
    pub shadow: &'static [u8],
}

macro_rules! modules {
    ($pose:literal) => {
        Modules {
            face: include_bytes!(concat!("../spirv/face_", $pose, ".vert.spv")),
            motion: include_bytes!(concat!("../spirv/motion_", $pose, ".vert.spv")),
            masks: include_bytes!(concat!("../spirv/masks_", $pose, ".vert.spv")),
            shadow: include_bytes!(concat!("../spirv/shadow_", $pose, ".vert.spv")),
        }
    };
}

pub const FRAGMENT: &[u8] = include_bytes!("../spirv/face.frag.spv");

const MODULES: [(&str, Modules); 3] =
    [("float32", modules!("float32")), ("fixed32", modules!("fixed32")), ("fixed16", modules!("fixed16"))];

/// Returns the modules for poses of a format.
pub fn of(pose: PoseFormat) -> Result<&'static Modules> {
    MODULES.iter().find(|(name, _)| *name == pose.decoder()).map(|(_, modules)| modules).ok_or_else(|| {
        Error::invalid(
            format!("there are no shaders that draw {} poses", pose.name()),
            "add the format to src/modules.rs of deltamorph-render",
        )
    })
}
