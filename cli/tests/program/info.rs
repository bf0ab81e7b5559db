//! `info`: the fields of its JSON, and what it says to people.

use crate::cli::{HEAD, has, json, ok};

#[test]
fn its_json_keeps_its_contract() {
    let plain = json(&[&["info", "--json", "-"], &HEAD[..]].concat());
    assert_eq!((&plain["schema"], &plain["blocks"]["size"]), (&1.into(), &32.into()));
    has(
        &plain,
        &[
            (
                "/input",
                "name origin vertices targets triangles diagonal bounding_box tolerance tolerance_normal moved_mean",
            ),
            ("/targets/0", "name moved moved_raw moved_raw_positions max_delta"),
            ("/overlap", "union mean max"),
            ("/blocks", "format size count incidence fill"),
            (
                "/pose_formats/0",
                "name vertex_bytes grid refused max_error_rel packing_error_rel weights_error_rel rounding_error_rel \
             measured_error_rel",
            ),
            ("/pose_formats/2/grid", "weight_bits weight_max position_unit_rel normal_unit targets_most"),
            (
                "/formats/0",
                "name delta_bytes index_bytes dense_f32_bytes position_error position_error_rel normal_error_deg",
            ),
        ],
    );
    let text = ok(&[&["info"], &HEAD[..]].concat());
    assert!(text.contains("1,200 vertices") && text.contains("eyeBlinkLeft"), "{text}");
    assert!(
        text.contains("deltas in small:")
            && text.contains("1 in steps of 2^-")
            && text.contains("12-byte format: fixed16,"),
        "{text}"
    );
    let names: Vec<&str> = plain["formats"].as_array().unwrap().iter().map(|f| f["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["float32", "snorm16", "fast", "small"]);
}

#[test]
fn streams_of_a_packed_file_are_listed() {
    use deltamorph::{DeltaFormat, PackDesc, PackedMesh, Tolerance};
    use deltamorph_head::{HeadDesc, head};
    let folder = tempfile::tempdir().unwrap();
    let mut mesh =
        head(&HeadDesc { vertices: 1200, targets: 12, ..Default::default() }).kept(Tolerance::default()).unwrap();
    for (name, streams) in [("plain", &[][..]), ("masks", &["wrinkle mask"])] {
        let file = folder.path().join(name).with_extension("dmorph");
        PackedMesh::pack(&mesh, &PackDesc::new(DeltaFormat::Small)).unwrap().write(&file).unwrap();
        let file = file.to_str().unwrap();
        assert_eq!(json(&["info", "--json", "-", file])["streams"], serde_json::json!(streams));
        assert_eq!(ok(&["info", file]).contains("further streams: wrinkle mask\n"), name == "masks");
        deltamorph_render::wrinkles::add(&mut mesh);
    }
}
