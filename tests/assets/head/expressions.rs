//! Targets of the built-in head: lids close, lips meet and open, left mirrors right, no part penetrates another.

use super::{desc, pieces};
use deltamorph::MorphSource;
use deltamorph_head::head;
use glam::Vec3;
use std::collections::{HashMap, HashSet};

/// Returns the positions with target `name` at weight 1.
fn posed(source: &MorphSource, name: &str) -> Vec<Vec3> {
    let mut positions = source.positions.clone();
    let target = source.targets.iter().find(|t| t.name == name).unwrap();
    target.positions.iter().for_each(|(v, d)| positions[*v as usize] += *d);
    positions
}

/// Returns the upper and lower vertices that face each other across the openings of the skin, which share a texture
/// coordinate: of the left eye, the right eye, the mouth.
fn edges(source: &MorphSource) -> [Vec<(usize, usize)>; 3] {
    let mut first = HashMap::new();
    let mut pairs = [vec![], vec![], vec![]];
    let mut found = HashSet::new();
    for corner in &source.faces.corners {
        let v = corner.position as usize;
        let other = *first.entry(corner.texcoord).or_insert(v);
        if other != v && found.insert((other, v)) {
            let p = source.positions[v];
            let pair = if source.positions[other].y > p.y { (other, v) } else { (v, other) };
            match () {
                () if p.x.abs() > 6.0 => {} // ears
                () if p.y < -3.0 => pairs[2].push(pair),
                () => pairs[usize::from(p.x < 0.0)].push(pair),
            }
        }
    }
    pairs
}

fn largest_gap(pairs: &[(usize, usize)], positions: &[Vec3]) -> f32 {
    pairs.iter().map(|&(a, b)| (positions[a] - positions[b]).length()).fold(0.0, f32::max)
}

#[test]
fn lids_close_and_lips_meet_and_open() {
    for vertices in [300, 4000, 20_000] {
        let source = head(&desc(vertices, 52, 0.12));
        let [left, right, mouth] = edges(&source);
        assert!(!left.is_empty() && left.len() == right.len() && !mouth.is_empty(), "{vertices}");
        let rest = &source.positions;
        assert!(largest_gap(&left, rest) > 0.7 && largest_gap(&right, rest) > 0.7);
        assert!(largest_gap(&mouth, rest) < 0.02, "lips are apart");
        let blink = posed(&source, "eyeBlinkLeft");
        let (closed, other) = (largest_gap(&left, &blink), largest_gap(&right, &blink));
        assert!(closed < 0.03 && other > 0.7, "{vertices}: {closed} cm between closed lids, {other} on the other side");
        assert!(largest_gap(&right, &posed(&source, "eyeBlinkRight")) < 0.03);
        let open = posed(&source, "jawOpen");
        assert!(largest_gap(&mouth, &open) > 2.0, "{vertices}: {}", largest_gap(&mouth, &open));
        assert!(largest_gap(&left, &open) > 0.7);
        // The upper lip stays above the lower one.
        assert!(mouth.iter().all(|&(a, b)| open[a].y > open[b].y - 0.02));
    }
}

/// Returns the `points` inside the closed surface `triangles`, by its crossings on the way towards +Z, outward minus
/// inward.
fn inside(points: &[usize], triangles: &[[u32; 3]], positions: &[Vec3]) -> Vec<usize> {
    const CELL: f64 = 0.4;
    let cell = |x: f64| (x / CELL).floor() as i32;
    let at = |v: usize| positions[v].as_dvec3();
    let mut cells = HashMap::<(i32, i32), Vec<[u32; 3]>>::new();
    for triangle in triangles {
        let [a, b, c] = triangle.map(|v| at(v as usize));
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        for x in cell(low.x)..=cell(high.x) {
            for y in cell(low.y)..=cell(high.y) {
                cells.entry((x, y)).or_default().push(*triangle);
            }
        }
    }
    let is_inside = |v: &usize| {
        // Offset from the mirrored vertices of the other side, and from their edges.
        let p = at(*v) + glam::DVec3::new(1.3e-5, 2.1e-5, 0.0);
        let mut winding = 0;
        for triangle in cells.get(&(cell(p.x), cell(p.y))).into_iter().flatten() {
            let [a, b, c] = triangle.map(|v| at(v as usize) - p);
            let [u, v, w] = [(b, c), (c, a), (a, b)].map(|(m, n)| m.x * n.y - m.y * n.x);
            let all = u + v + w;
            let hit = (u > 0.0 && v > 0.0 && w > 0.0) || (u < 0.0 && v < 0.0 && w < 0.0);
            if hit && (u * a.z + v * b.z + w * c.z) / all > 0.0 {
                winding += if all > 0.0 { 1 } else { -1 };
            }
        }
        winding != 0
    };
    points.iter().copied().filter(is_inside).collect()
}

#[test]
fn no_target_pushes_a_part_through_another() {
    let source = head(&desc(12_000, 52, 0.12));
    let piece = pieces(&source);
    let mut names: Vec<u32> = piece.clone();
    names.sort_unstable();
    names.dedup();
    let part = |k: usize| -> (Vec<usize>, Vec<[u32; 3]>) {
        let triangles =
            source.faces.triangles(&source.positions).into_iter().filter(|t| piece[t[0] as usize] == names[k]);
        ((0..piece.len()).filter(|&v| piece[v] == names[k]).collect(), triangles.collect())
    };
    let [skin, left, right, upper, lower, tongue] = std::array::from_fn(part);
    let bounds = |eye: &[usize]| {
        let all = eye.iter().map(|v| source.positions[*v]);
        all.fold((Vec3::MAX, Vec3::MIN), |(low, high), p| (low.min(p), high.max(p)))
    };
    // The test detects penetration: an eye behind the forehead is inside.
    let raised: Vec<Vec3> = source
        .positions
        .iter()
        .zip(&piece)
        .map(|(p, k)| *p + if *k == names[1] { Vec3::new(0.0, 5.0, -4.0) } else { Vec3::ZERO })
        .collect();
    assert_eq!(inside(&left.0, &skin.1, &raised).len(), left.0.len());
    for name in source.targets.iter().map(|t| t.name.as_str()) {
        let p = posed(&source, name);
        for (which, part) in
            [("eye", &left), ("eye", &right), ("teeth", &upper), ("teeth", &lower), ("tongue", &tongue)]
        {
            let stuck = inside(&part.0, &skin.1, &p);
            assert!(stuck.is_empty(), "{name}: {} vertices of the {which} are in the skin", stuck.len());
            let stuck = inside(&skin.0, &part.1, &p);
            assert!(stuck.is_empty(), "{name}: {} vertices of the skin are in the {which}", stuck.len());
        }
        for (a, b) in [(&upper, &lower), (&lower, &upper), (&tongue, &upper), (&tongue, &lower), (&lower, &tongue)] {
            assert!(inside(&a.0, &b.1, &p).is_empty(), "{name}: teeth or tongue");
        }
        // The skin against itself: nothing is just outside of it, except in the sharpest folds.
        let mut around = vec![Vec3::ZERO; p.len()];
        for triangle in &skin.1 {
            let [a, b, c] = triangle.map(|v| p[v as usize]);
            triangle.iter().for_each(|v| around[*v as usize] += (b - a).cross(c - a));
        }
        let mut with_outside = p.clone();
        with_outside.extend(p.iter().zip(&around).map(|(p, n)| *p + n.normalize_or(Vec3::Z) * 0.004));
        let outside: Vec<usize> = skin.0.iter().map(|v| v + p.len()).collect();
        let stuck = inside(&outside, &skin.1, &with_outside).len();
        assert!(stuck <= skin.0.len() / 200, "{name}: {stuck} vertices of the skin are in the skin");
        // Lids against the eyeball as a sphere, also between its vertices.
        for eye in [&left.0, &right.0] {
            let (low, high) = bounds(eye);
            let (centre, radius) = ((low + high) * 0.5, (high.x - low.x) * 0.5);
            let near = skin.0.iter().map(|&v| (p[v] - Vec3::new(centre.x, centre.y, low.z + radius)).length());
            let least = near.fold(f32::INFINITY, f32::min);
            assert!(least > radius, "{name}: a vertex of the lids is {} cm inside the eyeball", radius - least);
        }
    }
}

#[test]
fn left_and_right_mirror_each_other() {
    let flip = Vec3::new(-1.0, 1.0, 1.0);
    for vertices in [60, 901, 6000] {
        let source = head(&desc(vertices, 52, 0.12));
        let key = |p: Vec3| (p + Vec3::ZERO).to_array().map(f32::to_bits);
        let at: HashMap<_, _> = source.positions.iter().zip(0u32..).map(|(p, v)| (key(*p), v)).collect();
        assert_eq!(at.len(), vertices, "two vertices at one place");
        let mirror = |v: u32| at.get(&key(source.positions[v as usize] * flip)).copied();
        let mirrored = (0..vertices as u32).filter(|v| mirror(*v).is_some()).count();
        assert_eq!(mirrored, vertices);
        for left in source.targets.iter().filter(|t| t.name.ends_with("Left")) {
            let name = left.name.replace("Left", "Right");
            let deltas = |name: &str| -> HashMap<u32, Vec3> {
                source.targets.iter().find(|t| t.name == name).unwrap().positions.iter().copied().collect()
            };
            let (left, right) = (deltas(&left.name), deltas(&name));
            for (v, d) in &left {
                let other = right.get(&mirror(*v).unwrap()).copied().unwrap_or_default();
                // 20 µm: at the edge of a support, one side may have a vertex more.
                assert!((*d - other * flip).length() < 2.5e-3, "{name}, vertex {v}: {d} and {other}");
            }
        }
    }
}

#[test]
fn targets_do_what_their_names_say() {
    let source = head(&desc(8000, 52, 0.12));
    let [left, right, mouth] = edges(&source);
    let rest = &source.positions;
    let corner =
        |x: f32| mouth.iter().map(|m| m.0).max_by(|a, b| (rest[*a].x * x).total_cmp(&(rest[*b].x * x))).unwrap();
    let moved = |name: &str, v: usize| posed(&source, name)[v] - rest[v];
    let nearest = |p: [f32; 3]| {
        let off = |v: &usize| (rest[*v] - Vec3::from(p)).length();
        (0..rest.len()).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap()
    };
    // The head's left is +X.
    assert!(moved("mouthSmileLeft", corner(1.0)).y > 0.4 && moved("mouthSmileLeft", corner(-1.0)).length() < 0.1);
    assert!(moved("mouthSmileRight", corner(-1.0)).y > 0.4 && moved("mouthFrownLeft", corner(1.0)).y < -0.4);
    assert!(moved("mouthLeft", corner(1.0)).x > 0.3 && moved("mouthRight", corner(1.0)).x < -0.2);
    assert!(moved("mouthPucker", corner(1.0)).x < -0.25 && moved("mouthStretchLeft", corner(1.0)).x > 0.4);
    let chin = nearest([0.0, -9.0, 9.5]);
    assert!(moved("jawOpen", chin).y < -1.5 && moved("jawLeft", chin).x > 0.6 && moved("jawRight", chin).x < -0.6);
    assert!(moved("jawForward", chin).z > 0.5);
    let pupil = nearest([3.15, 1.0, 7.9]);
    assert!(moved("eyeLookUpLeft", pupil).y > 0.3 && moved("eyeLookDownLeft", pupil).y < -0.3);
    assert!(moved("eyeLookOutLeft", pupil).x > 0.4 && moved("eyeLookInLeft", pupil).x < -0.4);
    assert!(moved("eyeLookUpRight", pupil).length() < 0.01);
    assert!(largest_gap(&left, &posed(&source, "eyeWideLeft")) > 1.3 * largest_gap(&left, rest));
    assert!(largest_gap(&right, &posed(&source, "eyeSquintRight")) < 0.7 * largest_gap(&right, rest));
    assert!(
        moved("browInnerUp", nearest([1.2, 3.0, 9.0])).y > 0.3
            && moved("browDownLeft", nearest([2.5, 3.0, 9.0])).y < -0.2
    );
    assert!(
        moved("cheekPuff", nearest([4.6, -4.8, 7.0])).x > 0.4
            && moved("cheekPuff", nearest([-4.6, -4.8, 7.0])).x < -0.4
    );
    assert!(moved("tongueOut", nearest([0.0, -6.15, 7.0])).z > 2.0);
    for name in ["mouthFunnel", "mouthLowerDownLeft", "mouthUpperUpRight", "tongueOut"] {
        assert!(largest_gap(&mouth, &posed(&source, name)) > 0.3, "{name}");
    }
    for name in ["mouthClose", "mouthPucker", "mouthPressLeft", "mouthSmileLeft", "mouthShrugLower", "cheekPuff"] {
        assert!(largest_gap(&mouth, &posed(&source, name)) < 0.1, "{name}");
    }
}
