use super::*;
use std::collections::HashSet;

/// ARKit's names.
fn arkit() -> Vec<String> {
    let sides = |row: &table::Row| if row.sided { &["Left", "Right"][..] } else { &[""] };
    let rows = TABLE.iter().filter(|row| !row.arkit.is_empty());
    rows.flat_map(|row| sides(row).iter().map(|side| format!("{}{side}", row.arkit))).collect()
}

fn clip(names: &[&str], values: &[f32]) -> WeightClip {
    let names = names.iter().map(|&name| name.to_owned()).collect();
    WeightClip { name: "clip".into(), names, fps: 30.0, values: values.to_vec() }
}

/// Retargets a row of weights; returns names and weights of the result.
fn out(columns: &[(&str, f32)], targets: &[&str]) -> Vec<(String, f32)> {
    let (names, values): (Vec<&str>, Vec<f32>) = columns.iter().copied().unzip();
    let there = retarget(&clip(&names, &values), targets).unwrap().clip;
    there.names.into_iter().zip(there.values).collect()
}

fn named(list: &[(&str, f32)]) -> Vec<(String, f32)> {
    list.iter().map(|(name, weight)| ((*name).to_owned(), *weight)).collect()
}

#[test]
fn the_table_has_the_52_shapes_and_no_name_twice() {
    let names = arkit();
    assert_eq!(names.len(), 52);
    assert_eq!(names.iter().collect::<HashSet<_>>().len(), 52);
    let units: Vec<_> = TABLE.iter().filter_map(|row| row.makehuman).collect();
    assert_eq!(units.iter().map(|unit| unit.0).collect::<HashSet<_>>().len(), units.len());
    assert!(units.iter().all(|(_, to, from)| (0.0..=1.0).contains(to) && (0.0..=1.0).contains(from)));
    // The built-in head has the same names.
    let desc = deltamorph_head::HeadDesc::default().vertices(4).targets(52);
    let head: HashSet<String> = deltamorph_head::head(&desc).targets.into_iter().map(|t| t.name).collect();
    assert_eq!(names.into_iter().collect::<HashSet<_>>(), head);
}

#[test]
fn a_clip_in_the_meshs_own_names_stays_as_it_is() {
    let clip = clip(&["jawOpen", "smile"], &[0.25, 0.5, 1.0, 0.0]);
    let same = retarget(&clip, &["smile", "jawOpen", "x"]).unwrap();
    assert_eq!((&same.clip, same.columns.len()), (&clip, 0));
    // Unknown names are left for `bind` to report.
    let same = retarget(&clip, &["jawOpen"]).unwrap();
    assert_eq!(same.clip, clip);
    assert!(same.clip.bind(&["jawOpen"]).is_err());
}

#[test]
fn spellings_and_sides_of_arkit() {
    let targets = ["eyeBlink_L", "eyeBlink_R", "jawLeft", "browInnerUp_L", "browInnerUp_R"];
    let columns = [("EyeBlinkLeft", 0.5), ("eyeBlinkRight", 0.75), ("JawLeft", 1.0), ("browInnerUp", 0.25)];
    let wanted =
        [("eyeBlink_L", 0.5), ("eyeBlink_R", 0.75), ("jawLeft", 1.0), ("browInnerUp_L", 0.25), ("browInnerUp_R", 0.25)];
    assert_eq!(out(&columns, &targets), named(&wanted));
    // The reverse: each side gives half.
    let back = out(&[("browInnerUp_L", 1.0), ("browInnerUp_R", 0.5)], &["browInnerUp"]);
    assert_eq!(back, named(&[("browInnerUp", 0.75)]));
    // Only its own column drives a target that has one.
    let both = out(&[("browInnerUp", 0.5), ("browInnerUp_L", 1.0)], &["browInnerUp"]);
    assert_eq!(both, named(&[("browInnerUp", 0.5)]));
}

#[test]
fn action_units_to_arkit_and_back() {
    let names = arkit();
    let targets: Vec<&str> = names.iter().map(String::as_str).collect();
    assert_eq!(out(&[("AU12", 0.5)], &targets), named(&[("mouthSmileLeft", 0.5), ("mouthSmileRight", 0.5)]));
    assert_eq!(out(&[("AU06_R", 0.5)], &targets), named(&[("cheekSquintRight", 0.5)]));
    assert_eq!(out(&[("AU1L", 0.5)], &targets), named(&[("browInnerUp", 0.25)]));
    // The eyes turn to the left, and the jaw's left is not its right.
    assert_eq!(out(&[("AU61", 1.0)], &targets), named(&[("eyeLookInRight", 1.0), ("eyeLookOutLeft", 1.0)]));
    assert_eq!(out(&[("AU30_L", 1.0)], &targets), named(&[("jawLeft", 1.0)]));
    assert!(retarget(&clip(&["AU30"], &[1.0]), &targets).unwrap().lost().eq(["AU30"]));
    let back =
        out(&[("eyeLookInRight", 0.5), ("eyeLookOutLeft", 1.0), ("jawRight", 0.5)], &["AU61", "AU30_R", "AU30_L"]);
    assert_eq!(back, named(&[("AU61", 0.75), ("AU30_R", 0.5)]));
    let rolls = out(&[("AU28", 1.0)], &["mouthRollLower", "mouthRollUpper"]);
    assert_eq!(rolls, named(&[("mouthRollLower", 1.0), ("mouthRollUpper", 1.0)]));
    assert_eq!(out(&[("mouthRollLower", 1.0), ("mouthRollUpper", 0.5)], &["AU28"]), named(&[("AU28", 0.75)]));
    assert_eq!(out(&[("AU27", 0.5)], &["AU26"]), named(&[("AU26", 0.5)]));
    // Names of other schemes, or without an equivalent in ARKit.
    for other in ["AU12_r", "AU", "AU999", "AU0", "AU99", "au12", "AU12_L_x"] {
        assert_eq!(read(other), None, "{other}");
    }
}

#[test]
fn units_of_makehuman_by_the_first_ancestry() {
    let targets = ["asian_eye-left-closure", "caucasian_eye-left-closure", "mouth-corner-puller"];
    let there = out(&[("eyeBlinkLeft", 0.5), ("mouthSmile_L", 0.5), ("mouthSmile_R", 0.25)], &targets);
    assert_eq!(there, named(&[("caucasian_eye-left-closure", 0.5), ("mouth-corner-puller", 0.375)]));
    let back = out(&[("african_eye-right-closure", 0.5)], &["eyeBlinkRight"]);
    assert_eq!(back, named(&[("eyeBlinkRight", 0.2)]));
}

/// The controls of MHR, with sides and lips as `|`; those of XR_FB_face_tracking but for five.
const MHR: &str = "browLowerer_| cheekPuff_| cheekRaiser_| cheekSuck_| chinRaiser_B chinRaiser_T dimpler_| eyesClosed_| \
    eyesLookDown_| eyesLookLeft_| eyesLookRight_| eyesLookUp_| innerBrowRaiser_| jawDrop jawSidewaysLeft \
    jawSidewaysRight jawThrust lidTightener_| lipCornerDepressor_| lipCornerPuller_| lipFunneler_|B lipFunneler_|T \
    lipPressor_| lipPucker_| lipStretcher_| lipSuck_|B lipSuck_|T lipTightener_| lipsToward_|B lipsToward_|T \
    lowerLipDepressor_| mouthLeft mouthRight nasolabialFurrow_| noseWrinkler_| nostrilCompressor_| nostrilDilator_| \
    outerBrowRaiser_| upperLidRaiser_| upperLipRaiser_|";
const UNIFIED: &str = "EyeLookOut| EyeLookIn| EyeLookUp| EyeLookDown| EyeClosed| EyeDilation| EyeConstrict| EyeSquint| \
    EyeWide| BrowPinch| BrowLowerer| BrowInnerUp| BrowOuterUp| NasalDilation| NasalConstrict| CheekSquint| CheekPuff| \
    CheekSuck| JawOpen JawRight JawLeft JawForward JawBackward JawClench JawMandibleRaise MouthClosed LipSuckUpper| \
    LipSuckLower| LipSuckCorner| LipFunnelUpper| LipFunnelLower| LipPuckerUpper| LipPuckerLower| MouthUpperUp| \
    MouthUpperDeepen| NoseSneer| MouthLowerDown| MouthUpperRight MouthUpperLeft MouthLowerRight MouthLowerLeft \
    MouthCornerPull| MouthCornerSlant| MouthFrown| MouthStretch| MouthDimple| MouthRaiserUpper MouthRaiserLower \
    MouthPress| MouthTightener| TongueOut TongueUp TongueDown TongueRight TongueLeft TongueRoll TongueBendDown \
    TongueCurlUp TongueSquish TongueFlat TongueTwist| SoftPalateClose ThroatSwallow NeckFlex|";
const SIMPLE: &str = "BrowUp| BrowDown| MouthSmile| MouthSad|";
const VISEMES: &str = "sil PP FF TH DD kk CH SS nn RR aa E ih oh ou";
const VRM: [&str; 2] = [
    "neutral a i u e o blink joy angry sorrow fun lookup lookdown lookleft lookright blink_l blink_r",
    "happy angry sad relaxed surprised aa ih ou ee oh blink blinkLeft blinkRight lookUp lookDown lookLeft lookRight \
     neutral",
];

fn all_of(list: &str, sides: [&str; 2]) -> Vec<String> {
    let each = list.split_whitespace().map(|name| match name.contains('|') {
        true => sides.map(|side| name.replace('|', side)).to_vec(),
        false => vec![name.to_owned()],
    });
    each.flatten().collect()
}

#[test]
fn every_name_of_the_other_vocabularies_is_known() {
    let mhr = all_of(MHR, ["L", "R"]);
    let screaming = |name: &String| {
        let split = name.chars().flat_map(|c| [c.is_uppercase().then_some('_'), Some(c.to_ascii_uppercase())]);
        split.flatten().collect::<String>().replace("__", "_").replace("_L_B", "_LB").replace("_L_T", "_LT")
    };
    let is_fb = |name: &&String| !["nasolabial", "nostril", "lipsToward"].iter().any(|start| name.starts_with(start));
    let fb: Vec<String> = mhr.iter().filter(is_fb).map(screaming).chain(["LIPS_TOWARD".to_owned()]).collect();
    assert_eq!((mhr.len(), fb.len()), (72, 63));
    let named = |start: &str, end: &str| fb.iter().map(|name| format!("{start}{name}{end}")).collect::<Vec<_>>();
    let android = named("XR_FACE_PARAMETER_INDICES_", "_ANDROID").into_iter();
    let tongues = ["OUT", "LEFT", "RIGHT", "UP", "DOWN"].map(|way| format!("TONGUE_{way}"));
    let visemes = |start: &str| VISEMES.split(' ').map(|name| format!("{start}{name}")).collect::<Vec<_>>();
    for list in [
        mhr.clone(),
        named("XR_FACE_EXPRESSION_", "_FB"),
        named("XR_FACE_EXPRESSION2_", "_FB"),
        android.chain(tongues).collect(),
        all_of(UNIFIED, ["Left", "Right"]),
        all_of(SIMPLE, ["Left", "Right"]),
        visemes(""),
        visemes("viseme_"),
        visemes("vrc.v_"),
        all_of(VRM[0], [""; 2]),
        all_of(VRM[1], [""; 2]),
    ] {
        let meanings: HashSet<Name> = list.iter().map(|name| read(name).unwrap_or_else(|| panic!("{name}"))).collect();
        assert_eq!(meanings.len(), list.len(), "{list:?}");
    }
    // All shapes of ARKit come from each full list, and go to it, but for the tongue.
    let arkit = arkit();
    for list in [mhr, all_of(UNIFIED, ["Left", "Right"])] {
        let [from, to] = [(&list, &arkit), (&arkit, &list)].map(|(from, to)| {
            let targets: Vec<&str> = to.iter().map(String::as_str).collect();
            let columns: Vec<(&str, f32)> = from.iter().map(|name| (name.as_str(), 1.0)).collect();
            out(&columns, &targets).into_iter().filter(|(name, _)| targets.contains(&name.as_str())).collect::<Vec<_>>()
        });
        let missing: Vec<&String> = arkit.iter().filter(|name| !from.iter().any(|(found, _)| found == *name)).collect();
        assert!(missing.iter().all(|name| *name == "tongueOut"), "{missing:?}");
        assert!(from.iter().all(|(_, weight)| (0.99..=1.01).contains(weight)), "{from:?}");
        assert!(to.len() >= 60 && to.iter().all(|(_, weight)| (0.3..=1.01).contains(weight)), "{to:?}");
    }
}

#[test]
fn other_vocabularies_by_meaning_and_side() {
    let both = ["eyeLookOutLeft", "eyeLookInRight", "eyeLookInLeft", "eyeLookOutRight"];
    assert_eq!(out(&[("EYES_LOOK_LEFT_L", 0.5)], &both), named(&[("eyeLookOutLeft", 0.5)]));
    assert_eq!(out(&[("eyesLookLeft_R", 0.5)], &both), named(&[("eyeLookInRight", 0.5)]));
    let left = [("eyeLookInRight", 0.5), ("eyeLookOutLeft", 0.5)];
    assert_eq!(out(&[("lookLeft", 0.5)], &both), named(&left));
    assert_eq!(out(&left, &["LookLeft", "LookRight"]), named(&[("LookLeft", 1.0)]));
    // The same name, and another meaning.
    assert_eq!(out(&[("browLowerer_L", 1.0)], &["browDownLeft"]), named(&[("browDownLeft", 1.0)]));
    assert_eq!(out(&[("BrowLowererLeft", 1.0)], &["browDownLeft"]), named(&[("browDownLeft", 0.75)]));
    let slanted = ["MouthCornerPullRight", "MouthCornerSlantRight"];
    assert_eq!(out(&[("mouthSmileRight", 0.5)], &slanted), named(&[(slanted[0], 0.5), (slanted[1], 0.5)]));
    assert_eq!(out(&[("lipFunneler_LB", 1.0)], &["LipFunnelLowerLeft"]), named(&[("LipFunnelLowerLeft", 1.0)]));
    // Both ways between VRM 0, VRM 1 and visemes, and a mixture where there is no such target.
    assert_eq!(out(&[("joy", 1.0), ("A", 0.5)], &["happy", "aa"]), named(&[("happy", 1.0), ("aa", 0.5)]));
    assert_eq!(out(&[("viseme_ih", 0.5)], &["Fcl.I", "jawOpen"]), named(&[("Fcl.I", 0.5)]));
    assert_eq!(out(&[("viseme_SS", 1.0)], &["mouthLowerDown", "mouthSmile"]), {
        named(&[("mouthLowerDown", 0.8), ("mouthSmile", 0.3)])
    });
    assert_eq!(
        out(&[("jawOpen", 0.5), ("eyeBlinkLeft", 1.0)], &["A", "Blink_L"]),
        named(&[("A", 0.5), ("Blink_L", 1.0)])
    );
}

#[test]
fn the_last_part_of_a_name_counts() {
    let columns = [("face_shapes.ai_browDown_L", 0.5), ("blendShape1.eyeBlink_L", 1.0), ("rig:AU26", 0.25)];
    let wanted = [("browDownLeft", 0.5), ("eyeBlink.L", 1.0), ("jawOpen", 0.25)];
    assert_eq!(out(&columns, &wanted.map(|(name, _)| name)), named(&wanted));
    // Names that are in no table, and several nodes.
    let nodes = ["head.jawOpen", "teeth.jawOpen", "head.grumpy_2"];
    let driven = [("head.jawOpen", 0.5), ("teeth.jawOpen", 0.5), ("head.grumpy_2", 1.0)];
    assert_eq!(out(&[("jawOpen", 0.5), ("grumpy_2", 1.0)], &nodes), named(&driven));
    assert_eq!(out(&[("JawDrop", 0.5)], &nodes), named(&driven[..2]));
}

#[test]
fn what_is_no_clip_is_refused() {
    assert!(retarget(&clip(&["AU1", "AU1"], &[1.0, 1.0]), &["AU1"]).is_err());
    assert!(retarget(&clip(&["AU1"], &[f32::NAN]), &["AU1"]).is_err());
    assert_eq!(retarget(&WeightClip::default(), &["AU1"]).unwrap(), Retargeted::default());
}
