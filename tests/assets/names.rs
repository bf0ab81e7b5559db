//! The table of names: a captured ARKit clip plays on each of the faces, and unmapped names are reported.

use crate::data;
use deltamorph::import::{ImportDesc, ImportedMesh, csv, open};
use deltamorph::{MorphSource, WeightClip};
use deltamorph_head::{HeadDesc, head};
use deltamorph_rig::names::retarget;

fn mesh(name: &str) -> Option<MorphSource> {
    match open(&data::set(name)?, &ImportDesc::default()).unwrap().mesh {
        ImportedMesh::Source(source) => Some(source),
        ImportedMesh::Packed(_) => panic!("{name} is a folder"),
    }
}

fn captured() -> Option<WeightClip> {
    Some(csv::read(&data::set("facecap_head_glb")?.join("weights/facecap_30fps.csv"), None).unwrap())
}

fn names(source: &MorphSource) -> Vec<&str> {
    source.targets.iter().map(|target| target.name.as_str()).collect()
}

#[test]
fn a_captured_arkit_clip_plays_on_every_face() {
    let Some(clip) = captured() else { return };
    assert_eq!(clip.names.len(), 52);
    let faces = [("ict_facekit", &["tongueOut"][..]), ("makehuman_face", &[]), ("facecap_head_glb", &[])];
    let head = head(&HeadDesc::default().vertices(500));
    let faces = faces.into_iter().filter_map(|(name, lost)| Some((name, mesh(name)?, lost)));
    for (name, source, lost) in faces.chain([("the built-in head", head, &[][..])]) {
        let there = retarget(&clip, &names(&source)).unwrap();
        let kept = clip.names.len() - there.columns.len();
        println!(
            "{name}: {} of 52 mapped, {kept} are its own, lost: {:?}",
            there.mapped(),
            there.lost().collect::<Vec<_>>()
        );
        assert!(there.lost().eq(lost.iter().copied()), "{name}");
        let bound = there.clip.bind(&names(&source)).unwrap();
        assert_eq!(bound.frame_count(), clip.frame_count());
        // Every weight of the capture is present, under the face's own name.
        for (column, weight) in clip.names.iter().zip(&clip.values[100 * 52..]) {
            let own = vec![(column.clone(), 1.0)];
            let found = there.columns.iter().find(|(name, _)| name == column).map_or(&own, |(_, targets)| targets);
            for (target, factor) in found {
                let index = source.targets.iter().position(|t| t.name == *target).expect("a target of the face");
                assert_eq!(*factor, 1.0, "{name}: {column}");
                assert_eq!(bound.frame(100).unwrap()[index], *weight, "{name}: {column}");
            }
        }
    }
}

/// The table converts the capture to the same clips as those made by hand for these faces.
#[test]
fn the_tables_clips_are_those_made_by_hand() {
    let Some(clip) = captured() else { return };
    for name in ["ict_facekit", "makehuman_face"] {
        let (Some(source), Some(folder)) = (mesh(name), data::set(name)) else { return };
        let by_hand = csv::read(&folder.join("weights/facecap_30fps.csv"), None).unwrap();
        let there = retarget(&clip, &names(&source)).unwrap().clip;
        let [a, b] = [by_hand, there].map(|clip| clip.bind(&names(&source)).unwrap());
        assert!(a.frames().eq(b.frames()), "{name}");
    }
}

/// Every MakeHuman unit of the table is in the set, and alone drives ARKit's shapes.
#[test]
fn makehumans_units_are_those_of_the_set() {
    let Some(source) = mesh("makehuman_face") else { return };
    let Some(clip) = captured() else { return };
    let (units, arkit): (Vec<&str>, Vec<&str>) =
        names(&source).into_iter().filter(|name| !name.starts_with("viseme")).partition(|name| name.contains('-'));
    let there = retarget(&clip, &units).unwrap();
    println!("units of MakeHuman alone: {} of 52 mapped, lost: {:?}", there.mapped(), there.lost().collect::<Vec<_>>());
    assert!(there.clip.names.iter().all(|name| name.starts_with("caucasian_")));
    let of_units = WeightClip {
        names: units.iter().filter(|name| name.starts_with("asian_")).map(|&name| name.to_owned()).collect(),
        fps: 30.0,
        ..WeightClip::default()
    };
    let back = retarget(&of_units, &arkit).unwrap();
    let unknown: Vec<&String> = back.clip.names.iter().filter(|name| name.contains('-')).collect();
    println!("units that ARKit has nothing for: {unknown:?}");
    assert_eq!((there.mapped(), back.mapped()), (32, 26));
}
