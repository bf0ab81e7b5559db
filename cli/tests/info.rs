//! `info --report`: error against bytes, and the errors of whole poses; `textures`.

#[path = "common/cli.rs"]
mod cli;
#[path = "../../tests/common/data.rs"]
mod data;

use cli::{HEAD, fails, json, links_hold, ok, sample};

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
        text.contains("deltas in small:") && text.contains("fixed16") && text.contains("1 in steps of 2^-"),
        "{text}"
    );
    let names: Vec<&str> = plain["formats"].as_array().unwrap().iter().map(|f| f["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["float32", "snorm16", "block-float32", "fast", "small", "pair"]);

    // Twice: a report takes the place of an earlier one.
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

    // A folder of something else is left alone, whatever its files are called.
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
    use deltamorph::import::sample::{HeadDesc, head};
    use deltamorph::{Asset, DeltaFormat, PackDesc, Tolerance};
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

/// `textures` writes the targets of a mesh as textures, and `--textures` takes them from there: bit for bit, or as half floats
/// within their bound. On a real set as well, where there is one.
#[test]
fn textures_hold_the_targets_of_a_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let real = data::set("facecap_head_glb");
    let real = real.map(|folder| vec![folder.to_str().unwrap().to_owned()]);
    for mesh in [Some(vec![sample(folder.path())]), real].into_iter().flatten() {
        let mesh: Vec<&str> = mesh.iter().map(String::as_str).collect();
        let info = json(&[&["info", "--json", "-"], &mesh[..]].concat());
        let set = format!("{}=0.7", info["targets"][0]["name"].as_str().unwrap());
        let apply = |textures: &str, out: &str| {
            let textures = ["--textures", textures];
            let textures = if out == "plain.obj" { &[] } else { &textures[..] };
            let out = at(out);
            let fixed = ["--path", "cpu", "--format", "float32", "--set", &set, "-o", &out];
            ok(&[&["apply"], &mesh[..], textures, &fixed].concat());
            let text = std::fs::read_to_string(&out).unwrap();
            let positions = text.lines().filter_map(|line| line.strip_prefix("v "));
            positions.flat_map(|line| line.split(' ').map(|n| n.parse::<f64>().unwrap()).collect::<Vec<_>>()).collect()
        };
        let plain: Vec<f64> = apply("", "plain.obj");
        let write = |name: &str, more: &[&str]| {
            json(&[&["textures"], &mesh[..], &["-o", &at(name), "--json", "-"], more].concat())
        };
        let (single, half) = (write("single.ktx2", &[]), write("half.ktx2", &["--half"]));
        assert_eq!(std::fs::metadata(at("single.ktx2")).unwrap().len(), single["file_bytes"].as_u64().unwrap());
        assert_eq!((&single["rounding"]["positions"], &single["size"]), (&0.0.into(), &half["size"]));
        assert!(single["file_bytes"].as_u64() > half["file_bytes"].as_u64().map(|bytes| bytes * 18 / 10));
        assert_eq!(apply(&at("single.ktx2"), "single.obj"), plain);
        let halves = apply(&at("half.ktx2"), "half.obj");
        let off = halves.iter().zip(&plain).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        // Poses are written with so many digits.
        let bound = 0.7 * half["rounding"]["positions"].as_f64().unwrap() + 1e-5;
        assert!(off > 0.0 && off <= bound && bound < 0.01, "{off}, {bound} allowed");
    }
    let head = at("head");
    let refused = |args: &[&str], code: i32, words: &str| {
        let (status, text) = fails(args);
        assert!(status == code && text.contains(words), "{args:?}: {status}, {text}");
    };
    refused(&["textures", &head, "-o", &at("out.png")], 2, "name it *.ktx2");
    refused(&["info", &head, "--textures", &format!("{head}/neutral.obj")], 1, "no KTX 2.0 file");
    refused(&["info", &head, "--textures", &at("none.ktx2")], 1, "none.ktx2");
    ok(&["textures", "--vertices", "900", "--targets", "12", "-o", &at("other.ktx2")]);
    refused(&["info", &head, "--textures", &at("other.ktx2")], 1, "from the same mesh");
}
