//! A captured ARKit clip plays on each of the faces, whose names are spelt in other ways.

use crate::prelude::*;
use deltamorph::import::{ImportedMesh, csv, open};

fn mesh(name: &str) -> Option<Mesh> {
    match open(&data::set(name)?).unwrap().mesh {
        ImportedMesh::Source(source) => Some(source),
        ImportedMesh::Packed(_) => panic!("{name} is a folder"),
    }
}

#[test]
fn a_captured_arkit_clip_plays_on_every_face() {
    let Some(folder) = data::set("facecap_head_glb") else { return };
    let clip = csv::read(&folder.join("weights/facecap_30fps.csv"), None).unwrap();
    assert_eq!(clip.names.len(), 52);
    let of_ict = [
        "51 of 52 columns move targets; left out, as no target is called so: 'tongueOut'",
        "columns that move several targets at once: 'browInnerUp', 'cheekPuff'",
    ];
    let faces = [("ict_facekit", &of_ict[..]), ("makehuman_face", &[]), ("facecap_head_glb", &[])];
    let head = head(&HeadDesc { vertices: 500, ..Default::default() });
    let faces = faces.into_iter().filter_map(|(name, notes)| Some((name, data::set(name), mesh(name)?, notes)));
    for (name, folder, source, notes) in faces.chain([("the built-in head", None, head, &[][..])]) {
        let targets: Vec<&str> = source.targets.iter().map(|target| target.name.as_str()).collect();
        let bound = clip.bind(&targets).unwrap();
        assert_eq!(bound.notes, notes, "{name}");
        assert_eq!(bound.frame_count(), clip.frame_count());
        // The clips of the sets were made by hand, from this one.
        if let Some(folder) = folder {
            let by_hand = csv::read(&folder.join("weights/facecap_30fps.csv"), None).unwrap();
            assert!(bound.frames().eq(by_hand.bind(&targets).unwrap().frames()), "{name}");
        }
    }
}
