//! The table of the names of face shapes. To add a vocabulary: a variant of [`Vocabulary`], and its names in the rows of
//! the shapes that they mean; rows of its own for shapes that no other has.

use super::spelling::Side;

/// Lists of names, beside those with a column of their own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Vocabulary {
    /// XR_FB_face_tracking, its second version, XR_ANDROID_face_tracking, and the 72 controls of Meta's MHR.
    OpenXr,
    /// Unified Expressions of VRCFaceTracking.
    Unified,
    /// The 15 visemes of Oculus; `i`, `o` and `u` are spellings of Ready Player Me.
    Viseme,
    /// Presets of VRM 0 and VRM 1.
    Vrm,
}

/// A name in another vocabulary.
pub(super) struct Other {
    pub of: Vocabulary,
    /// Without `_`, in any case, `*` for the side.
    pub name: &'static str,
    /// The side of the row's shape, if the name has no `*` and the shape has sides.
    pub side: Option<Side>,
}

/// A shape of ARKit or, without a name, of other vocabularies only, and its names.
pub(super) struct Row {
    /// ARKit's name without the side; empty if it has none.
    pub arkit: &'static str,
    /// ARKit has a shape for each side.
    pub sided: bool,
    /// Numbers of FACS action units, for the left side and for the right one; 0: none. The first that the mesh has is
    /// used.
    pub facs: &'static [[u8; 2]],
    /// MakeHuman's expression unit, with `*` for the side; its weight for ARKit's weight 1; ARKit's weight for its
    /// weight 1.
    pub makehuman: Option<(&'static str, f32, f32)>,
    /// Names in other vocabularies, of the same weight. A mesh's targets of the first vocabulary that it has are used.
    pub others: &'static [Other],
    /// For a shape that ARKit does not have: ARKit's shapes in its place, their weights for its weight 1, and its
    /// weight for theirs.
    pub made_of: &'static [(&'static str, f32, f32)],
}

const fn each(arkit: &'static str, facs: &'static [[u8; 2]]) -> Row {
    Row { arkit, sided: true, facs, makehuman: None, others: &[], made_of: &[] }
}

const fn one(arkit: &'static str, facs: &'static [[u8; 2]]) -> Row {
    Row { sided: false, ..each(arkit, facs) }
}

/// A shape that ARKit does not have.
const fn more(others: &'static [Other]) -> Row {
    one("", &[]).also(others)
}

impl Row {
    const fn unit(self, name: &'static str, to: f32, from: f32) -> Self {
        Self { makehuman: Some((name, to, from)), ..self }
    }

    const fn also(self, others: &'static [Other]) -> Self {
        Self { others, ..self }
    }

    const fn made_of(self, made_of: &'static [(&'static str, f32, f32)]) -> Self {
        Self { made_of, ..self }
    }
}

const fn name(of: Vocabulary, name: &'static str, side: Option<Side>) -> Other {
    Other { of, name, side }
}

const fn xr(of: &'static str) -> Other {
    name(Vocabulary::OpenXr, of, None)
}

const fn unified(of: &'static str) -> Other {
    name(Vocabulary::Unified, of, None)
}

const fn viseme(of: &'static str) -> Other {
    name(Vocabulary::Viseme, of, None)
}

const fn vrm(of: &'static str) -> Other {
    name(Vocabulary::Vrm, of, None)
}

impl Other {
    const fn left(self) -> Self {
        Self { side: Some(Side::Left), ..self }
    }

    const fn right(self) -> Self {
        Self { side: Some(Side::Right), ..self }
    }
}

/// ARKit's 52 shapes, and those that only others have.
///
/// FACS: numbers of Ekman, Friesen and Hager, "Facial Action Coding System" (2002). MakeHuman's factors are projections
/// of its units on the ARKit shapes that TalkingHead made for the same mesh, and the reverse, rounded to a tenth and at
/// most 1; those of visemes are the least-squares fit of its visemes by its ARKit shapes, none below 0, without those
/// below 0.15. Parts of a shape in Unified Expressions have the factors with which VRCFaceTracking adds them up.
pub(super) const TABLE: [Row; 101] = [
    each("browDown", &[[4, 4]]).unit("eyebrows-*-down", 0.8, 0.2).also(&[xr("browLowerer*")]),
    one("browInnerUp", &[[1, 1]]).unit("eyebrows-*-inner-up", 0.9, 0.3).also(&[xr("innerBrowRaiser*")]),
    each("browOuterUp", &[[2, 2]]).unit("eyebrows-*-extern-up", 0.6, 0.7).also(&[xr("outerBrowRaiser*")]),
    one("cheekPuff", &[[34, 34], [33, 33]]).also(&[xr("cheekPuff*")]),
    each("cheekSquint", &[[6, 6]]).also(&[xr("cheekRaiser*")]),
    each("eyeBlink", &[[45, 45], [43, 43]]).unit("eye-*-closure", 1.0, 0.4).also(&[
        xr("eyesClosed*"),
        unified("eyeClosed*"),
        vrm("blink*"),
    ]),
    each("eyeLookDown", &[[64, 64]]).also(&[xr("eyesLookDown*"), vrm("lookDown")]),
    each("eyeLookIn", &[[62, 61]]).also(&[
        xr("eyesLookRightL").left(),
        xr("eyesLookLeftR").right(),
        vrm("lookRight").left(),
        vrm("lookLeft").right(),
    ]),
    each("eyeLookOut", &[[61, 62]]).also(&[
        xr("eyesLookLeftL").left(),
        xr("eyesLookRightR").right(),
        vrm("lookLeft").left(),
        vrm("lookRight").right(),
    ]),
    each("eyeLookUp", &[[63, 63]]).also(&[xr("eyesLookUp*"), vrm("lookUp")]),
    each("eyeSquint", &[[7, 7]]).unit("eye-*-slit", 0.3, 0.3).also(&[xr("lidTightener*")]),
    each("eyeWide", &[[5, 5]]).unit("eye-*-opened-up", 1.0, 0.5).also(&[xr("upperLidRaiser*")]),
    one("jawForward", &[[29, 29]]).also(&[xr("jawThrust")]),
    one("jawLeft", &[[30, 0]]).also(&[xr("jawSidewaysLeft")]),
    one("jawOpen", &[[26, 26], [27, 27]]).unit("mouth-open", 0.9, 0.8).also(&[xr("jawDrop")]),
    one("jawRight", &[[0, 30]]).also(&[xr("jawSidewaysRight")]),
    one("mouthClose", &[]).also(&[xr("lipsToward"), unified("mouthClosed")]),
    each("mouthDimple", &[[14, 14]]).unit("mouth-retraction", 0.9, 0.6).also(&[xr("dimpler*")]),
    each("mouthFrown", &[[15, 15]])
        .unit("mouth-depression", 0.8, 0.4)
        .also(&[xr("lipCornerDepressor*"), unified("mouthSad*")]),
    one("mouthFunnel", &[[22, 22]]).unit("mouth-protusion", 0.4, 0.9).also(&[unified("lipFunnel")]),
    one("mouthLeft", &[]).also(&[xr("mouthLeft")]),
    each("mouthLowerDown", &[[16, 16]]).unit("mouth-depression-retraction", 0.3, 1.0).also(&[xr("lowerLipDepressor*")]),
    each("mouthPress", &[[24, 24], [23, 23]]).unit("mouth-compression", 0.8, 0.4).also(&[xr("lipPressor*")]),
    one("mouthPucker", &[[18, 18]]).unit("mouth-pursing", 0.7, 1.0).also(&[xr("lipPucker*")]),
    one("mouthRight", &[]).also(&[xr("mouthRight")]),
    one("mouthRollLower", &[[28, 28]]).also(&[xr("lipSuck*B"), unified("lipSuckLower*")]),
    one("mouthRollUpper", &[[28, 28]]).also(&[xr("lipSuck*T"), unified("lipSuckUpper*")]),
    one("mouthShrugLower", &[[17, 17]])
        .unit("mouth-eversion", 0.7, 0.7)
        .also(&[xr("chinRaiserB"), unified("mouthRaiserLower")]),
    one("mouthShrugUpper", &[]).unit("mouth-parling", 1.0, 0.5).also(&[xr("chinRaiserT"), unified("mouthRaiserUpper")]),
    each("mouthSmile", &[[12, 12]]).unit("mouth-corner-puller", 1.0, 0.4).also(&[xr("lipCornerPuller*")]),
    each("mouthStretch", &[[20, 20]]).unit("neck-platysma", 0.8, 0.5).also(&[xr("lipStretcher*")]),
    each("mouthUpperUp", &[[10, 10]]).unit("mouth-elevation", 0.8, 0.8).also(&[xr("upperLipRaiser*")]),
    each("noseSneer", &[[9, 9]]).unit("nose-*-elevation", 0.9, 0.4).also(&[xr("noseWrinkler*")]),
    one("tongueOut", &[[19, 19]]).also(&[xr("tongueOut")]),
    more(&[unified("browPinch*")]).made_of(&[("browDown", 0.25, 1.0)]),
    more(&[unified("browLowerer*")]).made_of(&[("browDown", 0.75, 1.0)]),
    more(&[unified("browUp*")]).made_of(&[("browOuterUp", 1.0, 0.6), ("browInnerUp", 1.0, 0.4)]),
    more(&[unified("mouthCornerPull*")]).made_of(&[("mouthSmile", 0.8, 1.0)]),
    more(&[unified("mouthCornerSlant*")]).made_of(&[("mouthSmile", 0.2, 1.0)]),
    more(&[xr("lipFunneler*T"), unified("lipFunnelUpper*")]).made_of(&[("mouthFunnel", 0.5, 1.0)]),
    more(&[xr("lipFunneler*B"), unified("lipFunnelLower*")]).made_of(&[("mouthFunnel", 0.5, 1.0)]),
    more(&[unified("lipPuckerUpper*")]).made_of(&[("mouthPucker", 0.5, 1.0)]),
    more(&[unified("lipPuckerLower*")]).made_of(&[("mouthPucker", 0.5, 1.0)]),
    more(&[xr("lipsToward*T")]).made_of(&[("mouthClose", 0.5, 1.0)]),
    more(&[xr("lipsToward*B")]).made_of(&[("mouthClose", 0.5, 1.0)]),
    more(&[unified("mouthUpperLeft")]).made_of(&[("mouthLeft", 0.5, 1.0)]),
    more(&[unified("mouthLowerLeft")]).made_of(&[("mouthLeft", 0.5, 1.0)]),
    more(&[unified("mouthUpperRight")]).made_of(&[("mouthRight", 0.5, 1.0)]),
    more(&[unified("mouthLowerRight")]).made_of(&[("mouthRight", 0.5, 1.0)]),
    more(&[xr("cheekSuck*"), unified("cheekSuck*")]),
    more(&[xr("lipTightener*"), unified("mouthTightener*")]),
    more(&[xr("nostrilDilator*"), unified("nasalDilation*")]),
    more(&[xr("nostrilCompressor*"), unified("nasalConstrict*")]),
    more(&[xr("nasolabialFurrow*")]),
    more(&[xr("tongueUp"), unified("tongueUp")]),
    more(&[xr("tongueDown"), unified("tongueDown")]),
    more(&[xr("tongueLeft"), unified("tongueLeft")]),
    more(&[xr("tongueRight"), unified("tongueRight")]),
    more(&[xr("tongueTipInterdental")]),
    more(&[xr("tongueTipAlveolar")]),
    more(&[xr("tongueFrontDorsalPalate")]),
    more(&[xr("tongueMidDorsalPalate")]),
    more(&[xr("tongueBackDorsalVelar")]),
    more(&[xr("tongueRetreat")]),
    more(&[unified("eyeConstrict*")]),
    more(&[unified("eyeDilation*")]),
    more(&[unified("jawBackward")]),
    more(&[unified("jawClench")]),
    more(&[unified("jawMandibleRaise")]),
    more(&[unified("lipSuckCorner*")]),
    more(&[unified("mouthUpperDeepen*")]),
    more(&[unified("neckFlex*")]),
    more(&[unified("softPalateClose")]),
    more(&[unified("throatSwallow")]),
    more(&[unified("tongueBendDown")]),
    more(&[unified("tongueCurlUp")]),
    more(&[unified("tongueFlat")]),
    more(&[unified("tongueRoll")]),
    more(&[unified("tongueSquish")]),
    more(&[unified("tongueTwist*")]),
    more(&[viseme("sil")]),
    more(&[viseme("PP")]).made_of(&[
        ("mouthShrugLower", 0.9, 0.0),
        ("mouthRollUpper", 0.7, 0.0),
        ("mouthRollLower", 0.5, 0.0),
        ("mouthLowerDown", 0.2, 0.0),
        ("mouthPress", 0.2, 0.0),
    ]),
    more(&[viseme("FF")]).made_of(&[
        ("mouthShrugUpper", 1.0, 0.0),
        ("mouthRollLower", 0.6, 0.0),
        ("mouthDimple", 0.5, 0.0),
        ("mouthRollUpper", 0.2, 0.0),
    ]),
    more(&[viseme("TH")]).made_of(&[("mouthShrugUpper", 0.6, 0.0)]),
    more(&[viseme("DD")]).made_of(&[("mouthLowerDown", 0.3, 0.0), ("mouthUpperUp", 0.2, 0.0)]),
    more(&[viseme("kk")]).made_of(&[("mouthShrugUpper", 0.4, 0.0), ("mouthDimple", 0.4, 0.0)]),
    more(&[viseme("CH")]).made_of(&[
        ("mouthFunnel", 0.5, 0.0),
        ("mouthLowerDown", 0.4, 0.0),
        ("mouthShrugUpper", 0.2, 0.0),
    ]),
    more(&[viseme("SS")]).made_of(&[("mouthLowerDown", 0.8, 0.0), ("mouthSmile", 0.3, 0.0)]),
    more(&[viseme("nn")]).made_of(&[
        ("mouthLowerDown", 0.3, 0.0),
        ("mouthSmile", 0.3, 0.0),
        ("mouthFunnel", 0.3, 0.0),
        ("mouthUpperUp", 0.2, 0.0),
    ]),
    more(&[viseme("RR")]).made_of(&[
        ("mouthShrugUpper", 0.6, 0.0),
        ("mouthSmile", 0.3, 0.0),
        ("mouthUpperUp", 0.2, 0.0),
        ("mouthRollUpper", 0.2, 0.0),
        ("mouthLowerDown", 0.2, 0.0),
    ]),
    more(&[viseme("aa"), vrm("a")]).made_of(&[
        ("jawOpen", 0.5, 1.0),
        ("jawForward", 0.3, 0.0),
        ("mouthShrugLower", 0.2, 0.0),
    ]),
    more(&[viseme("E"), vrm("ee")]).made_of(&[
        ("mouthShrugUpper", 1.0, 0.0),
        ("mouthRollUpper", 0.6, 0.0),
        ("mouthSmile", 0.3, 0.0),
        ("mouthUpperUp", 0.2, 0.0),
        ("mouthPress", 0.2, 0.0),
    ]),
    more(&[viseme("ih"), viseme("i")]).made_of(&[("mouthDimple", 0.7, 0.0), ("mouthStretch", 0.3, 0.0)]),
    more(&[viseme("oh"), viseme("o")]).made_of(&[
        ("mouthPucker", 0.7, 0.0),
        ("mouthShrugUpper", 0.5, 0.0),
        ("mouthRollUpper", 0.3, 0.0),
        ("jawForward", 0.3, 0.0),
        ("mouthRollLower", 0.2, 0.0),
        ("mouthUpperUp", 0.2, 0.0),
    ]),
    more(&[viseme("ou"), viseme("u")]).made_of(&[("mouthPucker", 0.5, 1.0)]),
    more(&[vrm("joy"), vrm("happy")]),
    more(&[vrm("angry")]),
    more(&[vrm("sorrow"), vrm("sad")]),
    more(&[vrm("fun"), vrm("relaxed")]),
    more(&[vrm("surprised")]),
    more(&[vrm("neutral")]),
];
