use super::*;
use deltamorph::WeightClip;

const TARGETS: [&str; 5] = ["smile", "half", "full", "frown", "mend"];

fn keys(keys: &[(f32, &str)]) -> Vec<Key> {
    keys.iter().map(|(at, target)| Key::new(*at, *target)).collect()
}

fn rig() -> Rig {
    let blink = Control::new("blink").keys(keys(&[(1.0, "full"), (0.5, "half")]));
    Rig { controls: vec![blink], correctives: vec![Corrective::new("mend", &["blink", "smile"])], ..Rig::default() }
}

fn evaluated(rig: &Rig, controls: &[f32]) -> [f32; 5] {
    let mut weights = [9.0; 5];
    rig.bind(&TARGETS).unwrap().evaluate(controls, &mut weights).unwrap();
    weights
}

#[test]
fn a_control_goes_through_its_keys_without_a_jump() {
    let bound = rig().bind(&TARGETS).unwrap();
    assert_eq!(bound.controls().collect::<Vec<_>>(), ["blink", "smile", "frown"]);
    for (blink, half, full) in [
        (0.0, 0.0, 0.0),
        (0.25, 0.5, 0.0),
        (0.5, 1.0, 0.0),
        (0.75, 0.5, 0.5),
        (1.0, 0.0, 1.0),
        (1.5, 0.0, 1.5),
        (-0.25, -0.5, 0.0),
    ] {
        assert_eq!(evaluated(&rig(), &[blink, 0.0, 0.0]), [0.0, half, full, 0.0, 0.0], "at {blink}");
    }
    let (mut last, mut now) = ([0.0; 5], [0.0; 5]);
    for i in -2000..2000 {
        bound.evaluate(&[i as f32 / 1000.0, 0.5, 0.0], &mut now).unwrap();
        let jump = last.iter().zip(&now).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(i == -2000 || jump < 2.1e-3, "{jump} at {i}: the steepest piece has a slope of 2");
        last = now;
    }
}

#[test]
fn keys_lie_on_both_sides_and_limits_hold() {
    let jaw = Control::new("jaw").keys(keys(&[(-1.0, "frown"), (2.0, "full"), (-0.5, "half")])).limits([-0.75, 1.0]);
    let rig = Rig { controls: vec![jaw], correctives: vec![], ..Rig::default() };
    // Limits come before keys; other targets are controls of their own.
    for (value, frown, half, full) in
        [(-0.5, 0.0, 1.0, 0.0), (-9.0, 0.5, 0.5, 0.0), (0.5, 0.0, 0.0, 0.25), (9.0, 0.0, 0.0, 0.5)]
    {
        assert_eq!(evaluated(&rig, &[value, 0.125, 0.0]), [0.125, half, full, frown, 0.0], "at {value}");
    }
}

#[test]
fn a_sequence_of_shapes_follows_an_arc() {
    // A point on a quarter circle: with n shapes the chords are off by 1 - cos(90° / 2n).
    let off = |names: &[&str]| {
        let rig = Rig { controls: vec![Control::new("turn").sequence(names)], correctives: vec![], ..Rig::default() };
        let rig = rig.bind(names).unwrap();
        let arc = |t: f64| (t * std::f64::consts::FRAC_PI_2).sin_cos();
        let mut weights = vec![0.0; names.len()];
        let radius = |i: i32| {
            rig.evaluate(&[i as f32 / 100.0], &mut weights).unwrap();
            let sum = weights.iter().enumerate().fold((0.0, 1.0), |(x, y), (i, w)| {
                let (sin, cos) = arc((i + 1) as f64 / names.len() as f64);
                (x + f64::from(*w) * sin, y + f64::from(*w) * (cos - 1.0))
            });
            1.0 - sum.0.hypot(sum.1)
        };
        (0..=100).map(radius).fold(0.0, f64::max)
    };
    for (names, parts) in [(&["a"][..], 1.0), (&["a", "b"], 2.0), (&["a", "b", "c", "d"], 4.0)] {
        let expected = 1.0 - (std::f64::consts::FRAC_PI_4 / parts).cos();
        assert!((off(names) - expected).abs() < 0.02 * expected, "{} for {expected} of {names:?}", off(names));
    }
}

#[test]
fn correctives_are_products_that_no_negative_factor_turns_round() {
    let mend = |blink, smile| evaluated(&rig(), &[blink, smile, 0.0])[4];
    assert_eq!((mend(0.5, 0.5), mend(1.0, 0.0), mend(0.0, 1.0), mend(2.0, 0.5)), (0.25, 0.0, 0.0, 1.0));
    assert_eq!((mend(-1.0, 1.0), mend(-1.0, -1.0)), (0.0, 0.0));
    // Weights from several controls add up.
    let twice = [Control::new("a").keys(keys(&[(1.0, "smile")])), Control::new("b").keys(keys(&[(2.0, "smile")]))];
    let rig =
        Rig { controls: twice.into(), correctives: vec![Corrective::new("smile", &["a", "b"])], ..Rig::default() };
    assert_eq!(evaluated(&rig, &[0.5, 0.5, 0.0, 0.0, 0.0, 0.0])[0], 0.5 + 0.25 + 0.25);
}

#[test]
fn smoothing_depends_on_time_and_not_on_frames_and_ends() {
    let slow = Control::new("smile").smoothing(0.1).limits([0.0, 1.0]);
    let rig = Rig { controls: vec![slow, Control::new("frown")], correctives: vec![], ..Rig::default() }
        .bind(&TARGETS)
        .unwrap();
    let wanted = [5.0, 0.5, 0.0, 0.0, 0.0]; // held at 1
    let after = |frames: u32, seconds: f32| {
        let mut current = [0.0; 5];
        (0..frames).for_each(|_| rig.smooth(&mut current, &wanted, seconds / frames as f32).unwrap());
        current
    };
    for frames in [1, 3, 60] {
        let [smile, frown, ..] = after(frames, 0.1);
        assert!((smile - (1.0 - (-1.0f32).exp())).abs() < 1e-6, "{smile} in {frames} frames");
        assert_eq!(frown, 0.5, "at once");
    }
    assert_eq!(after(1, 0.0), [0.0; 5], "no time, no way");
    assert_eq!(after(60, 1.0)[..2], [1.0, 0.5], "it arrives");
}

#[test]
fn a_baked_clip_is_the_rig_frame_by_frame() {
    let names = vec!["smile".to_owned(), "blink".to_owned()];
    let clip = WeightClip { name: "clip".into(), names, fps: 10.0, values: vec![0.5, 0.0, 0.5, 1.0, 0.0, 0.25] };
    let bound = rig().bind(&TARGETS).unwrap();
    let baked = bound.bake(&clip, 10.0).unwrap();
    assert_eq!(baked.names, ["smile", "half", "full", "mend"], "what the clip has a part in");
    let rows = [[0.5, 0.0, 0.0, 0.0], [0.5, 0.0, 1.0, 0.5], [0.0, 0.5, 0.0, 0.0]];
    assert_eq!((baked.values.as_flattened_rows(4), baked.fps), (rows.map(Vec::from).to_vec(), 10.0));
    // At twice the rate, a frame falls on the key between two frames.
    let fine = bound.bake(&clip, 20.0).unwrap();
    assert_eq!((fine.frame_count(), &fine.values[4..8]), (5, &[0.5, 1.0, 0.0, 0.25][..]));
    assert_eq!(bound.bake(&clip, 15.0).unwrap().frame_count(), 4);
    let none = WeightClip { values: vec![], ..clip.clone() };
    assert_eq!(bound.bake(&none, 10.0).unwrap().frame_count(), 0);
    // Smoothed from the first frame on.
    let slow = Rig { controls: vec![Control::new("smile").smoothing(0.1)], correctives: vec![], ..Rig::default() }
        .bind(&TARGETS)
        .unwrap();
    let clip = WeightClip { names: vec!["smile".into()], values: vec![1.0, 0.0, 0.0], ..clip };
    let (baked, e) = (slow.bake(&clip, 10.0).unwrap(), (-1.0f32).exp());
    assert!(baked.values.iter().zip([1.0, e, e * e]).all(|(a, b)| (a - b).abs() < 1e-6), "{:?}", baked.values);
}

/// Rows of a fixed number of values.
trait Rows {
    fn as_flattened_rows(&self, columns: usize) -> Vec<Vec<f32>>;
}

impl Rows for Vec<f32> {
    fn as_flattened_rows(&self, columns: usize) -> Vec<Vec<f32>> {
        self.chunks(columns).map(<[f32]>::to_vec).collect()
    }
}

#[test]
fn without_a_rig_each_target_is_its_own_control_bit_for_bit() {
    let bound = Rig::default().bind(&TARGETS).unwrap();
    let (controls, mut weights) = ([0.1, -0.7, 1e-7, 3.3, 0.0], [9.0; 5]);
    bound.evaluate(&controls, &mut weights).unwrap();
    assert_eq!((weights, bound.controls().collect::<Vec<_>>()), (controls, TARGETS.to_vec()));
    assert_eq!(Rig::default().bind(&[]).unwrap().controls().len(), 0);
    // Of two targets of one name, clips use the first.
    assert_eq!(Rig::default().bind(&["a", "a"]).unwrap().controls().collect::<Vec<_>>(), ["a"]);
}

#[test]
fn what_cannot_be_bound_is_refused_with_a_remedy() {
    let control = |name: &str, of: &[(f32, &str)]| Control::new(name).keys(keys(of));
    let one = |control: Control| Rig { controls: vec![control], correctives: vec![], ..Rig::default() };
    let mend = |of: &[&str]| Rig { correctives: vec![Corrective::new("mend", of)], ..rig() };
    for (rig, words) in [
        (
            one(control("a", &[(1.0, "full_")])),
            "control 'a' of the rig: 'full_' is no target; use 'full' if that is meant",
        ),
        (one(control("Smile", &[])), "control 'Smile' of the rig: 'Smile' is no target; use 'smile'"),
        (one(control("a", &[(0.0, "full")])), "target 'full' at 0; use a finite number other than 0"),
        (one(control("a", &[(f32::NAN, "full")])), "target 'full' at NaN"),
        (
            one(control("a", &[(0.5, "half"), (0.5, "full")])),
            "targets 'half' and 'full' are both at 0.5; give each key",
        ),
        (one(Control::new("smile").limits([1.0, 0.0])), "limits from 1 to 0; give the least value first"),
        (one(Control::new("smile").limits([f32::NAN, 0.0])), "limits from NaN to 0"),
        (one(Control::new("smile").smoothing(-1.0)), "a smoothing of -1 seconds; use a finite number"),
        (
            one(control("smile", &[(1.0, "full")])),
            "controls 0 and 1 of the rig are both called 'smile'; rename or remove",
        ),
        (mend(&[]), "corrective 'mend' of the rig: no control drives it"),
        (mend(&["blnk"]), "corrective 'mend' of the rig: 'blnk' is no control; use 'blink' if that is meant"),
        (mend(&["half"]), "'half' is no control"),
        (mend(&["smile", "smile"]), "control 'smile' is named twice"),
        (
            Rig { correctives: vec![Corrective::new("x", &["blink"])], ..rig() },
            "corrective 'x' of the rig: 'x' is no target",
        ),
    ] {
        deltamorph::testing::says(rig.bind(&TARGETS), &[words]);
    }
}

#[test]
fn wrong_weights_are_refused_and_change_nothing() {
    let bound = rig().bind(&TARGETS).unwrap();
    let (mut weights, mut current) = ([9.0; 5], [0.25; 3]);
    for (controls, words) in [
        (&[0.0; 2][..], "2 weights for the rig's 3 controls; give one per control"),
        (&[0.0, f32::NAN, 0.0], "control 'smile' of the rig: the weight is NaN"),
    ] {
        deltamorph::testing::says(bound.evaluate(controls, &mut weights), &[words]);
        deltamorph::testing::says(bound.smooth(&mut current, controls, 1.0), &[words]);
    }
    let text = bound.evaluate(&[0.0; 3], &mut [0.0; 4]).unwrap_err().to_string();
    assert!(text.contains("4 weights for the rig's 5 targets"), "{text}");
    let text = bound.smooth(&mut current, &[0.0; 3], -1.0).unwrap_err().to_string();
    assert!(text.contains("-1 seconds since the last frame"), "{text}");
    assert_eq!((weights, current), ([9.0; 5], [0.25; 3]));
    let clip = WeightClip { name: "clip".into(), names: vec!["half".into()], fps: 10.0, values: vec![1.0] };
    deltamorph::testing::says(
        bound.bake(&clip, 10.0),
        &["column 'half' names no control of the rig; use a control of the rig"],
    );
    let clip = WeightClip { names: vec!["blink".into()], ..clip };
    assert!(bound.bake(&clip, 0.0).unwrap_err().to_string().contains("clip 'clip': 0 frames a second"));
    let clip = WeightClip { values: vec![0.0, 1.0], ..clip };
    for fps in [1e9, f32::MAX] {
        deltamorph::testing::says(bound.bake(&clip, fps), &["more than 2^24 weights"]);
    }
}

#[test]
fn many_keys_columns_and_factors_take_no_search_through_all_others() {
    let many = 300_000;
    let names: Vec<String> = (0..many).map(|i| format!("t{i}")).collect();
    let targets: Vec<&str> = names.iter().map(String::as_str).collect();
    let keys: Vec<Key> = (1..).zip(&targets).map(|(i, target)| Key::new(i as f32, *target)).collect();
    let controls = vec![Control::new("all").keys(keys.clone())];
    let started = std::time::Instant::now();
    let bound = Rig { controls, correctives: vec![], ..Rig::default() }.bind(&targets).unwrap();
    assert_eq!(bound.controls().len(), 1);
    let all = Rig { controls: vec![], correctives: vec![Corrective::new("t0", &targets[1..])], ..Rig::default() };
    let bound = all.bind(&targets).unwrap();
    let columns: Vec<String> = bound.controls().map(str::to_owned).collect();
    let clip = WeightClip { name: "clip".into(), values: vec![0.0; columns.len()], names: columns, fps: 10.0 };
    assert_eq!(bound.bake(&clip, 10.0).unwrap().names.len(), many);
    assert!(started.elapsed().as_secs() < 30, "{:?}", started.elapsed());
    let twice = keys.iter().chain([&Key::new(7.0, "t9")]).cloned().collect();
    let text =
        Rig { controls: vec![Control::new("all").keys(twice)], correctives: vec![], ..Rig::default() }.bind(&targets);
    assert!(text.unwrap_err().to_string().contains("targets 't6' and 't9' are both at 7;"));
}
