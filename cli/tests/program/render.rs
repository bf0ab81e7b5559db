//! `render`: pictures against reviewed ones, on every driver; clips.
//!
//! `UPDATE_PICTURES=1 ./with-vulkan cargo test -p deltamorph-cli --test program render` redraws the pictures after a
//! change of the built-in head or the light: review each of them before committing.

use crate::cli::{clip, ok, pixels, sample};
use std::fs::File;
use std::path::{Path, PathBuf};

/// Allowed mean difference, 0 to 1: drivers round edges and shadows differently.
const SEEN: f64 = 0.003;
/// Edge of the squares whose means are compared, in pixels: an edge that is a sample further is no difference.
const SQUARE: usize = 4;
/// Options of the built-in head.
const MESH: [&str; 6] = ["--vertices", "6000", "--targets", "52", "--size", "256x256"];

/// The pictures: names, and options.
const PICTURES: [(&str, &str); 11] = [
    ("neutral", "--camera 25,5"),
    ("expression", "--set jawOpen=0.7,mouthSmileLeft=0.8,browInnerUp=1,eyeBlinkRight=1 --pose fixed16"),
    ("behind", "--camera 180,10 --path cpu"),
    ("heat", "--set jawOpen=1 --heat distance"),
    ("crowd", "--crowd 5 --format small --background e8e8ea"),
    ("wire", "--set jawOpen=0.7 --show wire"),
    ("normals", "--set jawOpen=0.7 --show normals --camera -30,10"),
    ("motion", "--set mouthSmileLeft=1,browOuterUpRight=1 --show motion --pose fixed32"),
    ("blocks", "--set mouthSmileLeft=1,eyeBlinkRight=1 --show blocks --camera 0,0"),
    (
        "wrinkles",
        "--set browInnerUp=1,browOuterUpLeft=1,browOuterUpRight=1,mouthSmileLeft=1,mouthSmileRight=1 \
        --show wrinkles --camera 8,2",
    ),
    ("transparent", "--background none --set cheekPuff=1"),
];

fn drivers() -> Vec<String> {
    let list = std::env::var("DELTAMORPH_TEST_DRIVERS").unwrap_or_else(|_| "llvmpipe".into());
    list.split(',').map(str::to_owned).collect()
}

/// Returns the path of a reviewed picture. Vulkan does not define which samples a line covers, so pictures with lines
/// are per driver.
fn golden(name: &str, driver: &str) -> PathBuf {
    let name = if name == "wire" { format!("wire_{driver}") } else { name.to_owned() };
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/pictures/{name}.png"))
}

/// Draws one of the pictures.
fn draw(args: &str, driver: &str, out: &Path) {
    let out = ["render", "--quiet", "--device", driver, "-o", out.to_str().expect("UTF-8")];
    ok(&out.into_iter().chain(MESH).chain(args.split_whitespace()).collect::<Vec<_>>());
}

/// Sums of red, green and blue of each square of a picture, in front of grey.
fn squares(path: &Path) -> Vec<[f64; 3]> {
    let ([width, height], rgba) = pixels(path);
    let [across, down] = [width, height].map(|edge| (edge as usize).div_ceil(SQUARE));
    let mut sums = vec![[0.0; 3]; across * down];
    for (i, pixel) in rgba.chunks_exact(4).enumerate() {
        let x = i % width as usize;
        let y = i / width as usize;
        let opacity = f64::from(pixel[3]) / 255.0;
        let square = &mut sums[y / SQUARE * across + x / SQUARE];
        for (sum, colour) in square.iter_mut().zip(pixel) {
            *sum += f64::from(*colour) / 255.0 * opacity + 0.5 * (1.0 - opacity);
        }
    }
    sums
}

/// The mean difference of the squares of two pictures of the same size, 0 to 1.
fn seen(a: &Path, b: &Path) -> f64 {
    let [a, b] = [a, b].map(squares);
    assert_eq!(a.len(), b.len());
    let off = a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| (a - b).abs()).sum::<f64>();
    off / (3 * a.len() * SQUARE * SQUARE) as f64
}

#[test]
fn pictures_are_those_that_were_looked_at() {
    let folder = tempfile::tempdir().expect("a folder");
    let update = std::env::var_os("UPDATE_PICTURES").is_some_and(|v| v == "1");
    for (i, driver) in drivers().iter().enumerate() {
        for (name, args) in PICTURES {
            let out = folder.path().join(format!("{i}_{name}.png"));
            draw(args, driver, &out);
            let golden = golden(name, driver);
            if update && (i == 0 || golden != self::golden(name, &drivers()[0])) {
                std::fs::copy(&out, &golden).expect("a copy");
            }
            let off = seen(&out, &golden);
            println!("{driver} {name}: {off}");
            let remedy = "look at both, and draw them anew with UPDATE_PICTURES=1 if the change is meant";
            assert!(off < SEEN, "{driver}: {name} is {off} off what was looked at; {remedy}");
        }
    }
    // The bound distinguishes one picture from another, and an expression from its neighbour.
    for (i, (name, _)) in PICTURES.iter().enumerate() {
        for (other, _) in &PICTURES[..i] {
            let [a, b] = [name, other].map(|name| golden(name, &drivers()[0]));
            let off = seen(&a, &b);
            assert!(off > 2.0 * SEEN, "{name} and {other}: {off}");
        }
    }
    let nearby = folder.path().join("nearby.png");
    let set = "--set jawOpen=0.7,mouthSmileLeft=0.8,browInnerUp=1,eyeBlinkRight=1,noseSneerLeft=1";
    draw(set, &drivers()[0], &nearby);
    let off = seen(&nearby, &golden("expression", &drivers()[0]));
    println!("nearby: {off}");
    assert!(off > SEEN / 20.0, "{off}");
}

#[test]
fn clips_are_their_frames() {
    let (folder, head) = sample();
    let [animated, frames, one] = ["clip.apng", "frames", "one.png"].map(|name| folder.at(name));
    let args = ["render", &head, "--size", "96x96", "--quiet"];
    ok(&[&args[..], &["--clip", &animated]].concat());
    // Left from an earlier, longer clip.
    std::fs::create_dir(&frames).expect("a folder");
    folder.file("frames/frame_00024.png", "old");
    ok(&[&args[..], &["--clip", &frames]].concat());
    let clip = clip(&head);
    ok(&[&args[..], &["--weights", &clip, "--frame", "17", "-o", &one]].concat());

    let mut names: Vec<_> =
        std::fs::read_dir(&frames).expect("frames").map(|f| f.expect("a file").file_name()).collect();
    names.sort();
    assert_eq!((names.len(), names[23].to_str()), (24, Some("frame_00023.png")));
    let mut reader = png::Decoder::new(File::open(&animated).expect("a file")).read_info().expect("a PNG");
    assert_eq!(reader.info().animation_control.map(|a| (a.num_frames, a.num_plays)), Some((24, 0)));
    for (i, name) in names.iter().enumerate() {
        let mut bytes = vec![0; reader.output_buffer_size()];
        reader.next_frame(&mut bytes).expect("a frame");
        assert!(bytes == pixels(&Path::new(&frames).join(name)).1, "frame {i}");
        // The pose results from updates: rounding may have moved an edge.
        if i == 17 {
            let alone = pixels(Path::new(&one)).1;
            assert!(bytes.iter().zip(&alone).filter(|(a, b)| a.abs_diff(**b) > 4).count() < 20);
        }
    }
}
