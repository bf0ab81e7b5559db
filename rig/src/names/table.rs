//! The table of the names of face shapes.

/// A shape of ARKit, and its equivalents in the other schemes.
pub(super) struct Row {
    /// ARKit's name without the side.
    pub arkit: &'static str,
    /// ARKit has a shape for each side.
    pub sided: bool,
    /// Numbers of FACS action units, for the left side and for the right one; 0: none. The first that the mesh has is
    /// used.
    pub facs: &'static [[u8; 2]],
    /// MakeHuman's expression unit, with `*` for the side; its weight for ARKit's weight 1; ARKit's weight for its
    /// weight 1.
    pub makehuman: Option<(&'static str, f32, f32)>,
}

const fn each(arkit: &'static str, facs: &'static [[u8; 2]]) -> Row {
    Row { arkit, sided: true, facs, makehuman: None }
}

const fn one(arkit: &'static str, facs: &'static [[u8; 2]]) -> Row {
    Row { sided: false, ..each(arkit, facs) }
}

impl Row {
    const fn unit(self, name: &'static str, to: f32, from: f32) -> Self {
        Self { makehuman: Some((name, to, from)), ..self }
    }
}

/// ARKit's 52 shapes. FACS: numbers of Ekman, Friesen and Hager, "Facial Action Coding System" (2002). MakeHuman's
/// factors are projections of its units on the ARKit shapes that TalkingHead made for the same mesh, and the reverse,
/// rounded to a tenth and at most 1.
pub(super) const TABLE: [Row; 34] = [
    each("browDown", &[[4, 4]]).unit("eyebrows-*-down", 0.8, 0.2),
    one("browInnerUp", &[[1, 1]]).unit("eyebrows-*-inner-up", 0.9, 0.3),
    each("browOuterUp", &[[2, 2]]).unit("eyebrows-*-extern-up", 0.6, 0.7),
    one("cheekPuff", &[[34, 34], [33, 33]]),
    each("cheekSquint", &[[6, 6]]),
    each("eyeBlink", &[[45, 45], [43, 43]]).unit("eye-*-closure", 1.0, 0.4),
    each("eyeLookDown", &[[64, 64]]),
    each("eyeLookIn", &[[62, 61]]),
    each("eyeLookOut", &[[61, 62]]),
    each("eyeLookUp", &[[63, 63]]),
    each("eyeSquint", &[[7, 7]]).unit("eye-*-slit", 0.3, 0.3),
    each("eyeWide", &[[5, 5]]).unit("eye-*-opened-up", 1.0, 0.5),
    one("jawForward", &[[29, 29]]),
    one("jawLeft", &[[30, 0]]),
    one("jawOpen", &[[26, 26], [27, 27]]).unit("mouth-open", 0.9, 0.8),
    one("jawRight", &[[0, 30]]),
    one("mouthClose", &[]),
    each("mouthDimple", &[[14, 14]]).unit("mouth-retraction", 0.9, 0.6),
    each("mouthFrown", &[[15, 15]]).unit("mouth-depression", 0.8, 0.4),
    one("mouthFunnel", &[[22, 22]]).unit("mouth-protusion", 0.4, 0.9),
    one("mouthLeft", &[]),
    each("mouthLowerDown", &[[16, 16]]).unit("mouth-depression-retraction", 0.3, 1.0),
    each("mouthPress", &[[24, 24], [23, 23]]).unit("mouth-compression", 0.8, 0.4),
    one("mouthPucker", &[[18, 18]]).unit("mouth-pursing", 0.7, 1.0),
    one("mouthRight", &[]),
    one("mouthRollLower", &[[28, 28]]),
    one("mouthRollUpper", &[[28, 28]]),
    one("mouthShrugLower", &[[17, 17]]).unit("mouth-eversion", 0.7, 0.7),
    one("mouthShrugUpper", &[]).unit("mouth-parling", 1.0, 0.5),
    each("mouthSmile", &[[12, 12]]).unit("mouth-corner-puller", 1.0, 0.4),
    each("mouthStretch", &[[20, 20]]).unit("neck-platysma", 0.8, 0.5),
    each("mouthUpperUp", &[[10, 10]]).unit("mouth-elevation", 0.8, 0.8),
    each("noseSneer", &[[9, 9]]).unit("nose-*-elevation", 0.9, 0.4),
    one("tongueOut", &[[19, 19]]),
];
