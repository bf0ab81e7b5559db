//! Clips of weights as CSV files.

use crate::{Memory, Random, Target, bounded, check_error, scratch, write};
use deltamorph::import::csv;

pub const TARGET: Target = Target { name: "csv", run, mutate, seeds: Vec::new };

fn run(data: &[u8]) {
    let path = write("clip_24fps.csv", data);
    let read = bounded("csv::read", data.len(), Memory { base: 1 << 20, per_byte: 200 }, || csv::read(&path, None));
    let clip = match read {
        Ok(clip) => clip,
        Err(error) => return check_error(error),
    };
    assert_eq!(clip.values.len(), clip.frame_count() * clip.names.len());
    // A column without numbers is none of weights, and NaN throughout.
    assert!(clip.fps > 0.0 && clip.fps.is_finite() && !clip.values.iter().any(|value| value.is_infinite()));
    for (column, name) in clip.names.iter().enumerate() {
        let mut numbers = clip.values.iter().skip(column).step_by(clip.names.len());
        assert!(
            numbers.clone().all(|value| value.is_finite()) || !numbers.any(|value| *value != 0.0 && !value.is_nan()),
            "{name}"
        );
    }
    let names: Vec<&str> = clip.names.iter().map(String::as_str).rev().collect();
    match clip.bind(&names) {
        Ok(bound) => assert!(bound.frames().all(|frame| frame.len() == names.len())),
        Err(error) => check_error(error),
    }
    let targets = ["jawOpen", "eyeBlinkLeft", "mouthSmile_L", "head.a", "teeth.a"];
    match clip.bind(&targets) {
        Ok(bound) => assert!(bound.frames().all(|frame| frame.len() == targets.len())),
        Err(error) => check_error(error),
    }
    // A clip that is written is read back unchanged.
    let out = scratch().join("out.csv");
    match csv::write(&out, &clip) {
        Ok(()) => {
            let back = csv::read(&out, Some(clip.fps)).expect("it was written");
            assert_eq!((&back.names, &back.values), (&clip.names, &clip.values));
        }
        Err(error) => check_error(error),
    }
}

/// Repeats and removes lines and cells.
fn mutate(data: &[u8], random: &mut Random) -> Option<Vec<u8>> {
    let divider = *random.choose(b"\n\n,;:");
    let mut pieces: Vec<&[u8]> = data.split(|byte| *byte == divider).collect();
    let (from, to) = (random.below(pieces.len()), random.below(pieces.len()));
    match random.below(3) {
        0 => _ = pieces.remove(from),
        1 => pieces.insert(to, pieces[from]),
        _ => drop(pieces.splice(to..to, vec![pieces[from]; 1 << random.below(10)])),
    }
    Some(pieces.join(&divider))
}
