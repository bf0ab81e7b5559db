//! A blink: the distance of the lids from the eyeball on the way, with the target alone and with an in-between.

use super::{desc, pieces};
use deltamorph::MorphSource;
use deltamorph::glam::DVec3;
use deltamorph_head::{HeadDesc, head, head_rig};
use deltamorph_rig::{BoundRig, Rig};

/// Steps from open to closed.
const STEPS: u16 = 64;

/// The skin near an eyeball, its targets, and the eyeball as a sphere.
struct Lids<'a> {
    source: &'a MorphSource,
    near: Vec<usize>,
    centre: DVec3,
    radius: f64,
}

impl<'a> Lids<'a> {
    /// Makes the lids of the head's own left (+X) or right side.
    fn new(source: &'a MorphSource, sign: f64) -> Self {
        let piece = pieces(source);
        let at = |v: usize| source.positions[v].as_dvec3();
        // The skin is the piece of vertex 0; pieces are in the order skin, eyeballs, teeth.
        let mut names: Vec<u32> = piece.clone();
        names.sort_unstable();
        names.dedup();
        let eye = names[1..3].iter().copied().find(|name| at(*name as usize).x * sign > 0.0).unwrap();
        let ball: Vec<DVec3> = (0..piece.len()).filter(|v| piece[*v] == eye).map(at).collect();
        let (low, high) = ball.iter().fold((DVec3::MAX, DVec3::MIN), |(low, high), p| (low.min(*p), high.max(*p)));
        // Iris and pupil are hollow: the widest and the farthest points at the back define the sphere.
        let radius = (high.x - low.x) / 2.0;
        let centre = DVec3::new((low.x + high.x) / 2.0, (low.y + high.y) / 2.0, low.z + radius);
        let skin = (0..piece.len()).filter(|v| piece[*v] == piece[0] && at(*v).distance(centre) < 2.0 * radius);
        Self { source, near: skin.collect(), centre, radius }
    }

    /// Returns the smallest distance of the lids from the eyeball; negative inside.
    fn clearance(&self, weights: &[f32]) -> f64 {
        let mut positions: Vec<DVec3> = self.source.positions.iter().map(|p| p.as_dvec3()).collect();
        for (target, weight) in self.source.targets.iter().zip(weights).filter(|(_, w)| **w != 0.0) {
            for (v, delta) in &target.positions {
                positions[*v as usize] += delta.as_dvec3() * f64::from(*weight);
            }
        }
        let distances = self.near.iter().map(|v| positions[*v].distance(self.centre));
        distances.fold(f64::INFINITY, f64::min) - self.radius
    }

    /// Returns the smallest distance during a whole blink, and its position on the way.
    fn least(&self, rig: &BoundRig, control: &str) -> (f64, f32) {
        let index = rig.controls().position(|name| name == control).unwrap();
        let mut controls = vec![0.0; rig.controls().len()];
        let mut weights = vec![0.0; self.source.targets.len()];
        let mut at = |step: u16| {
            controls[index] = f32::from(step) / f32::from(STEPS);
            rig.evaluate(&controls, &mut weights).unwrap();
            (self.clearance(&weights), controls[index])
        };
        (0..=STEPS).map(&mut at).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap()
    }
}

fn bound(rig: &Rig, source: &MorphSource) -> BoundRig {
    let names: Vec<&str> = source.targets.iter().map(|target| target.name.as_str()).collect();
    rig.bind(&names).unwrap()
}

#[test]
fn a_blink_with_an_in_between_goes_round_the_eyeball_and_without_goes_through_it() {
    let with = HeadDesc::default().in_betweens(true);
    let source = head(&with);
    let (alone, through) = (bound(&Rig::default(), &source), bound(&head_rig(&with), &source));
    for (sign, control) in [(1.0, "eyeBlinkLeft"), (-1.0, "eyeBlinkRight")] {
        let lids = Lids::new(&source, sign);
        assert!(lids.near.len() > 1000, "{} vertices near an eyeball", lids.near.len());
        // No other target at weight 1 pushes a lid into the eyeball.
        for (index, target) in source.targets.iter().enumerate() {
            let mut weights = vec![0.0; source.targets.len()];
            weights[index] = 1.0;
            let clear = lids.clearance(&weights);
            assert!(clear > 0.0, "{}: {clear} cm from the eyeball", target.name);
        }
        let rest = lids.clearance(&vec![0.0; source.targets.len()]);
        let (straight, at) = lids.least(&alone, control);
        let (round, round_at) = lids.least(&through, control);
        println!(
            "{control}: {rest:.4} cm at rest; target alone {straight:.4} at {at}, with an in-between {round:.4} at \
             {round_at}"
        );
        assert!(straight < -0.015, "{control} alone: {straight} cm from the eyeball");
        assert!(round > 0.01, "{control} with an in-between: {round} cm from the eyeball");
    }
}

#[test]
fn in_betweens_are_two_more_targets() {
    let with = desc(3000, 60, 0.12).in_betweens(true);
    let more = head(&with);
    let names: Vec<&str> = more.targets[60..].iter().map(|target| target.name.as_str()).collect();
    assert_eq!(names, ["eyeBlinkLeft_half", "eyeBlinkRight_half"]);
    assert_eq!(head_rig(&with).controls.len(), 2);
    // Missing in-betweens are not named.
    assert_eq!(head_rig(&desc(3000, 60, 0.12)), Rig::default());
    let few = desc(3000, 1, 0.12).in_betweens(true);
    assert_eq!(head(&few).targets.len(), 2);
    assert!(head_rig(&few).bind(&["eyeBlinkLeft", "eyeBlinkLeft_half"]).is_ok());
}
