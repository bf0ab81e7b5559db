//! Rigs: a JSON file; after a zero byte, the frame rates of a clip and of its baked form (four bytes each).

use crate::{Memory, Random, Target, bounded, check_error, parts, write};
use deltamorph::WeightClip;
use deltamorph_rig::BoundRig;
use std::collections::HashSet;

pub const TARGET: Target = Target { name: "rig", run, mutate, seeds };

const MEMORY: Memory = Memory { base: 1 << 20, per_byte: 300 };

fn run(data: &[u8]) {
    let [json, rates] = parts(data);
    let path = write("rig.json", json);
    let rig = match bounded("rig::read", json.len(), MEMORY, || deltamorph_rig::read(&path)) {
        Ok(rig) => rig,
        Err(error) => return check_error(error),
    };
    let keys = rig.controls.iter().flat_map(|c| c.keys.iter().map(|key| key.target.as_str()));
    // A control without keys moves the target with its name.
    let driven = keys.chain(rig.controls.iter().filter(|c| c.keys.is_empty()).map(|c| c.name.as_str()));
    let driven = driven.chain(rig.correctives.iter().map(|c| c.target.as_str())).chain(["a", "b", "jawOpen"]);
    let mut seen = HashSet::new();
    let targets: Vec<&str> = driven.filter(|name| seen.insert(*name)).collect();
    match bounded("Rig::bind", json.len(), MEMORY, || rig.bind(&targets)) {
        Ok(bound) => {
            evaluate(&bound, targets.len(), crc32fast::hash(data));
            bake(&bound, rates);
        }
        Err(error) => check_error(error),
    }
}

fn evaluate(rig: &BoundRig, targets: usize, choice: u32) {
    let controls = rig.controls().len();
    let mut weights = vec![0.0; targets];
    for frame in 0..4 {
        let value = |i: usize| {
            [0.0, 1.0, -1.0, 0.5, 1e6, -1e-30, 0.25, 2.0][(choice as usize >> (frame * 3)).wrapping_add(i) % 8]
        };
        let values: Vec<f32> = (0..controls).map(value).collect();
        match rig.evaluate(&values, &mut weights) {
            Ok(()) => assert!(weights.iter().all(|w| !w.is_nan()), "{values:?} gives {weights:?}"),
            Err(error) => check_error(error),
        }
        let mut current = values.clone();
        current.rotate_left(frame.min(controls));
        match rig.smooth(&mut current, &values, 0.02 * frame as f32) {
            Ok(()) => assert!(current.iter().all(|v| v.is_finite()), "{values:?} gives {current:?}"),
            Err(error) => check_error(error),
        }
    }
    assert!(rig.evaluate(&vec![f32::NAN; controls], &mut weights).is_err() || controls == 0);
    assert!(rig.evaluate(&vec![0.0; controls + 1], &mut weights).is_err());
}

/// Bakes two frames of three controls, at the rates in the input.
fn bake(rig: &BoundRig, rates: &[u8]) {
    let rate = |at: usize| rates.get(4 * at..4 * at + 4).map_or(30.0, |b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let names: Vec<String> = rig.controls().take(3).map(str::to_owned).collect();
    let values = [0.0, 0.5, 1.0, 1.0, 0.0, -1.0][..names.len() * 2].to_vec();
    let clip = WeightClip { name: "clip".into(), names, fps: rate(0), values };
    // The same limit as for clips that are read: at most 2^24 weights of four bytes each, with room to grow to twice
    // that.
    let memory = Memory { base: 2 << 26, per_byte: 0 };
    let columns = clip.names.len();
    match bounded("BoundRig::bake", rates.len(), memory, || rig.bake(&clip, rate(1))) {
        Ok(baked) => assert!(baked.values.iter().all(|w| !w.is_nan()) || columns == 0),
        Err(error) => check_error(error),
    }
}

/// Repeats and removes items of lists, and changes numbers.
fn mutate(data: &[u8], random: &mut Random) -> Option<Vec<u8>> {
    let [json, rates] = parts(data);
    if random.below(4) == 0 {
        let mut rates = rates.to_vec();
        rates.resize(8, 0);
        let rate = *random.choose(&[30.0f32, 24.0, 0.0, -1.0, 1e9, 1e-9, 1e-30, f32::MAX, f32::NAN]);
        let at = 4 * random.below(2);
        rates[at..at + 4].copy_from_slice(&rate.to_le_bytes());
        return Some([json, b"\0", &rates].concat());
    }
    let divider = *random.choose(b",,:\"{");
    let mut pieces: Vec<&[u8]> = json.split(|byte| *byte == divider).collect();
    let (from, to) = (random.below(pieces.len()), random.below(pieces.len()));
    let words: [&[u8]; 8] = [b"0", b"1", b"-1", b"1e-45", b"3.4e38", b"null", b"a", b"[]"];
    match random.below(4) {
        0 => _ = pieces.remove(from),
        1 => pieces[to] = pieces[from],
        2 => drop(pieces.splice(to..to, vec![pieces[from]; 1 << random.below(10)])),
        _ => pieces[to] = words[random.below(words.len())],
    }
    Some([&pieces.join(&divider), &b"\0"[..], rates].concat())
}

fn seeds() -> Vec<(String, Vec<u8>)> {
    let all = r#"{"controls":[{"name":"blink","limits":[0,1],"smoothing":0.05,"keys":[{"at":0.5,"target":"half"},
        {"at":1,"target":"full"},{"at":-1,"target":"wide"}]},{"name":"turn","sequence":["turn_1","turn_2"]},
        {"name":"jawOpen","limits":[-1,2]}],"correctives":[{"target":"both","controls":["blink","jawOpen"]}]}"#;
    let rates = [all.as_bytes(), b"\0", &30f32.to_le_bytes(), &24f32.to_le_bytes()].concat();
    vec![("all".into(), rates), ("empty".into(), b"{}".into())]
}
