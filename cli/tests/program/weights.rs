//! From clips to weights of targets: names in other spellings, weights of absolute poses.

use crate::cli::{Folder, HEAD, deltamorph, fails, json, ok};

#[test]
fn a_clip_in_other_names_plays_and_what_is_left_over_is_said() {
    let folder = Folder::new();
    let play = |text: &str| {
        let clip = folder.file("clip.csv", text);
        let out = deltamorph(&[&["play", "--path", "cpu", "--weights", &clip, "--json", "-"], &HEAD[..]].concat());
        let stderr = String::from_utf8(out.stderr).unwrap();
        (out.status.success(), serde_json::from_slice(&out.stdout).unwrap_or(serde_json::Value::Null), stderr)
    };
    let changed = |played: &serde_json::Value| [0, 1].map(|i| played["frames"][i]["changed"].as_u64().unwrap());
    let (_, own, said) = play("eyeBlinkLeft,eyeBlinkRight\n0.5,0.25\n0,1\n");
    assert!(changed(&own) == [2, 2] && !said.contains("columns move targets"), "{said}");
    let (_, other, said) = play("eyeBlink_L,eyeBlink_R,tongueOut\n0.5,0.25,1\n0,1,1\n");
    assert!(said.contains("2 of 3 columns move targets; left out, as no target is called so: 'tongueOut'"), "{said}");
    assert_eq!(own["frames"][1]["bytes_moved"], other["frames"][1]["bytes_moved"]);
    let (played, _, said) = play("eyeBlnkLeft,x\n0.5,1\n");
    assert!(!played && said.contains("; rename 'eyeBlnkLeft' to 'eyeBlinkLeft' if that is meant"), "{said}");
    let (played, _, said) = play("Timecode;eyeBlinkLeft;Head Yaw;\n1:2:3:4;50;9;\n1:2:3:5.5;;8;\n");
    assert!(played && said.contains("called so: 'Timecode', 'Head Yaw', 'column 4'"), "{said}");
    assert!(said.contains("column 'Timecode' gives no frame rate: 30 a second is assumed; give --fps"), "{said}");
    assert!(said.contains("weights up to 50, but 1 applies a target in full: are they percentages?"), "{said}");
    let apply = |set: &str| fails(&[&["apply", "--path", "cpu", "--set", set, "-o", "x.obj"], &HEAD[..]].concat());
    assert!(apply("eyeBlnkLeft=1").1.contains("lists its 12 targets; did you mean 'eyeBlinkLeft'?"));
    assert!(apply("eyeblinkleft=1, eyeBlink_L=0").1.contains("--set eyeBlink_L: set twice"));
}

#[test]
fn weights_of_absolute_poses_are_normalised() {
    let folder = Folder::new();
    // From the second frame on one weight changes; above a sum of one that changes every nonzero factor.
    let clip = folder
        .file("clip.csv", "eyeBlinkLeft,eyeBlinkRight,eyeWideLeft\n0.75,0.5,0.75\n0.75,0.5,0.25\n0.25,0.5,0.25\n");
    let play = |more: &[&str]| {
        let out = json(&[&["play", "--path", "cpu", "--weights", &clip, "--json", "-"], &HEAD[..], more].concat());
        let changed = [0, 1, 2].map(|i| out["frames"][i]["changed"].as_u64().unwrap());
        (changed, out["summary"]["normalise"].as_bool().unwrap())
    };
    assert_eq!(play(&[]), ([3, 1, 1], false));
    assert_eq!(play(&["--normalise"]), ([3; 3], true));
    // Set weights are normalised, too: two poses, half of each.
    let [a, b] = [("0.5", &[][..]), ("1", &["--normalise"])].map(|(weight, more)| {
        let (set, out) = (format!("eyeBlinkLeft={weight},eyeBlinkRight={weight}"), folder.at(&format!("{weight}.obj")));
        ok(&[&["apply", "--path", "cpu", "--set", &set, "-o", &out], &HEAD[..], more].concat());
        std::fs::read_to_string(out).unwrap()
    });
    assert_eq!(a, b);
}

#[test]
fn fixed_point_poses_hold_the_weights_of_the_clip() {
    let folder = Folder::new();
    let clip = folder.file("clip.csv", "eyeBlinkLeft,eyeWideRight\n1.25,0.5\n-1.75,0.5\n");
    let play = |more: &[&str]| {
        let args = ["play", "--path", "cpu", "--format", "small", "--pose", "fixed16", "--weights", &clip];
        let out = deltamorph(&[&args[..], &HEAD[..], more].concat());
        (out.status.success(), String::from_utf8(out.stderr).unwrap())
    };
    let (played, said) = play(&[]);
    assert!(played && said.contains("weights up to 1.75: the range of fixed16 poses is extended to them"), "{said}");
    let (played, said) = play(&["--noise", "0.5"]);
    assert!(played && said.contains("weights up to 2.25: the range of fixed16"), "{said}");
    let (played, said) = play(&["--weight-max", "1"]);
    assert!(!played && said.contains("use a larger weight_max"), "{said}");
    let out = folder.at("out.obj");
    let set = ["apply", "--path", "cpu", "--pose", "fixed16", "--set", "eyeBlinkLeft=1.5", "-o", &out];
    ok(&[&set[..], &HEAD[..]].concat());
}
