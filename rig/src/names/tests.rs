use super::*;
use std::collections::HashSet;

/// ARKit's names.
fn arkit() -> Vec<String> {
    let sides = |row: &table::Row| if row.sided { &["Left", "Right"][..] } else { &[""] };
    TABLE.iter().flat_map(|row| sides(row).iter().map(|side| format!("{}{side}", row.arkit))).collect()
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

#[test]
fn what_is_no_clip_is_refused() {
    assert!(retarget(&clip(&["AU1", "AU1"], &[1.0, 1.0]), &["AU1"]).is_err());
    assert!(retarget(&clip(&["AU1"], &[f32::NAN]), &["AU1"]).is_err());
    assert_eq!(retarget(&WeightClip::default(), &["AU1"]).unwrap(), Retargeted::default());
}
