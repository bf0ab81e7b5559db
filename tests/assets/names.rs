//! A captured ARKit clip plays on each of the faces, whose names are spelt in other ways.

use crate::data;
use deltamorph::MorphSource;
use deltamorph::import::{ImportDesc, ImportedMesh, csv, open};
use deltamorph_head::{HeadDesc, head};

fn mesh(name: &str) -> Option<MorphSource> {
    match open(&data::set(name)?, &ImportDesc::default()).unwrap().mesh {
        ImportedMesh::Source(source) => Some(source),
        ImportedMesh::Packed(_) => panic!("{name} is a folder"),
    }
}

#[test]
fn a_captured_arkit_clip_plays_on_every_face() {
    let Some(folder) = data::set("facecap_head_glb") else { return };
    let clip = csv::read(&folder.join("weights/facecap_30fps.csv"), None).unwrap();
    assert_eq!(clip.names.len(), 52);
    let faces = [("ict_facekit", Some("tongueOut")), ("makehuman_face", None), ("facecap_head_glb", None)];
    let head = head(&HeadDesc::default().vertices(500));
    let faces = faces.into_iter().filter_map(|(name, lost)| Some((name, data::set(name), mesh(name)?, lost)));
    for (name, folder, source, lost) in faces.chain([("the built-in head", None, head, None)]) {
        let targets: Vec<&str> = source.targets.iter().map(|target| target.name.as_str()).collect();
        let bound = clip.bind(&targets).unwrap();
        let missing =
            lost.map(|name| format!("51 of 52 columns move targets; left out, as no target is called so: '{name}'"));
        assert_eq!(bound.notes, Vec::from_iter(missing), "{name}");
        assert_eq!(bound.frame_count(), clip.frame_count());
        // The clips of the sets were made by hand, from this one.
        if let Some(folder) = folder {
            let by_hand = csv::read(&folder.join("weights/facecap_30fps.csv"), None).unwrap();
            assert!(bound.frames().eq(by_hand.bind(&targets).unwrap().frames()), "{name}");
        }
    }
}
