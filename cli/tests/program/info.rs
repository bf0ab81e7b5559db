//! `info --report`: error against bytes, and the errors of whole poses.

use crate::cli::{HEAD, fails, json, links_hold, ok, sample};

#[test]
fn the_report_states_error_against_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("report");
    let info = |more: &[&str]| json(&[&["info", "--json", "-"], &HEAD[..], more].concat());
    let plain = info(&[]);
    assert!(plain.get("sweep").is_none() && plain.get("poses").is_none());
    assert_eq!((&plain["schema"], &plain["blocks"]["size"]), (&1.into(), &32.into()));
    for (part, fields) in [
        ("/input", "name origin vertices targets triangles diagonal tolerance tolerance_normal moved_mean"),
        ("/targets/0", "name moved moved_raw moved_raw_positions max_delta max_normal_delta"),
        ("/overlap", "union mean max"),
        ("/blocks", "size count incidence fill"),
        ("/pose_formats/0", "name vertex_bytes grid refused"),
        (
            "/pose_formats/2/grid",
            "weight_bits weight_max position_unit position_unit_rel normal_unit targets_most rounding_error \
             rounding_error_rel",
        ),
        (
            "/formats/0",
            "name delta_bytes index_bytes dense_f32_bytes position_error position_error_rel normal_error_deg",
        ),
    ] {
        let object = plain.pointer(part).expect(part);
        fields.split(' ').for_each(|f| assert!(object.get(f).is_some(), "{part}/{f}"));
    }
    let text = ok(&[&["info"], &HEAD[..]].concat());
    assert!(text.contains("1,200 vertices") && text.contains("eyeBlinkLeft"), "{text}");
    assert!(
        text.contains("deltas in small:") && text.contains("1 in steps of 2^-") && text.contains("a vertex: fixed16,"),
        "{text}"
    );
    let names: Vec<&str> = plain["formats"].as_array().unwrap().iter().map(|f| f["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["float32", "snorm16", "block-float32", "fast", "small", "pair"]);

    // Twice: a report replaces an earlier one.
    let report = ["--report", dir.to_str().unwrap()];
    let (_, out) = (info(&report), info(&report));
    let sweep = out["sweep"].as_array().unwrap();
    let number = |row: &serde_json::Value, field: &str| row[field].as_f64().unwrap_or_else(|| panic!("{field}: {row}"));
    for size in [32, 64, 128] {
        let line: Vec<_> =
            sweep.iter().filter(|r| r["block_size"] == size && r["position_allowed_rel"].is_number()).collect();
        assert_eq!(line.len(), 7);
        for (coarse, fine) in line.iter().zip(&line[1..]) {
            assert!(number(fine, "bytes") > number(coarse, "bytes"), "{coarse} {fine}");
            assert!(number(fine, "position_error_rel") < number(coarse, "position_error_rel"), "{coarse} {fine}");
        }
        assert!(line.iter().all(|r| number(r, "position_error_rel") <= 1.0001 * number(r, "position_allowed_rel")));
    }
    let poses = out["poses"].as_array().unwrap();
    assert_eq!(poses.len(), 6, "six formats, one clip");
    for pose in poses {
        assert_eq!((&pose["clip"], &pose["frames"]), (&"head".into(), &32.into()));
        assert!(number(pose, "position_error_rel") < 1e-4 && pose["normal_error_deg"].is_number(), "{pose}");
    }
    for file in ["index.html", "info.json", "position-error.svg", "position-error.png", "normal-error.svg"] {
        assert!(dir.join(file).metadata().unwrap().len() > 500, "{file}");
    }
    let page = std::fs::read_to_string(dir.join("index.html")).unwrap();
    assert!(page.matches("<svg").count() == 2 * 2 && page.contains("Whole poses") && !page.contains("src="));

    assert_eq!(page.matches("<tr>").count(), 1 + 6 + 1 + sweep.len(), "a table of poses, and one of every point");

    links_hold(&dir);

    // A folder of another kind is left alone, whatever the names of its files.
    std::fs::write(dir.join("info.json"), "{}").unwrap();
    let (code, text) = fails(&["info", "--vertices", "100", "--targets", "3", "--report", dir.to_str().unwrap()]);
    assert!(code == 2 && text.contains("something else") && text.contains("--report"), "{text}");
}

#[test]
fn a_rate_that_is_given_beats_that_of_the_file_name() {
    let folder = tempfile::tempdir().unwrap();
    let dir = sample(folder.path());
    let fps =
        |more: &[&str]| json(&[&["info", &dir, "--json", "-"], more].concat())["clips"][0]["fps"].as_f64().unwrap();
    assert_eq!((fps(&[]), fps(&["--fps", "60"])), (30.0, 60.0), "the file's name ends in 30fps");
}

#[test]
fn streams_of_a_packed_file_are_listed() {
    use deltamorph::{Asset, DeltaFormat, PackDesc, Tolerance};
    use deltamorph_head::{HeadDesc, head};
    let folder = tempfile::tempdir().unwrap();
    let mut mesh = head(&HeadDesc::default().vertices(1200).targets(12)).to_mesh(Tolerance::default()).unwrap();
    for (name, streams) in [("plain", &[][..]), ("masks", &["wrinkle mask"])] {
        let file = folder.path().join(name).with_extension("dmorph");
        Asset::pack(&mesh, &PackDesc::new(DeltaFormat::Small)).unwrap().write(&file).unwrap();
        let file = file.to_str().unwrap();
        assert_eq!(json(&["info", "--json", "-", file])["streams"], serde_json::json!(streams));
        assert_eq!(ok(&["info", file]).contains("further streams: wrinkle mask\n"), name == "masks");
        deltamorph_render::wrinkles::add(&mut mesh);
    }
}
