//! Levels of detail on every path: what is dropped and faded is what the float64 reference makes of the weights that remain.

#[path = "common/gpu.rs"]
mod gpu;

use deltamorph::headless::HeadlessCrowd;
use deltamorph::lod::{Importance, Level, LevelDesc};
use deltamorph::reference::{compare, evaluate_unpacked};
use deltamorph::{
    BatchSize, CpuCrowd, CrowdDesc, DeltaFormat, MorphEngine, PackDesc, PackedMesh, UpdateDesc, UpdateMode, UpdatePath,
    testing,
};
use gpu::{NORMAL, POSITION, on_every_device};
use std::sync::Arc;

const TARGETS: usize = 12;

/// A description for each path, and each kind of pose.
fn paths(engine: &MorphEngine) -> Vec<(DeltaFormat, UpdateDesc)> {
    let [fixed32, fixed16] = gpu::fixed();
    let compute = UpdateDesc::new(UpdatePath::Compute, BatchSize::Targets(4));
    let mut list = vec![
        (DeltaFormat::Small, UpdateDesc::blocks()),
        (DeltaFormat::Fast, fixed32),
        (DeltaFormat::Fast, fixed16.slots(3)),
        (DeltaFormat::Small, UpdateDesc::blocks().mode(UpdateMode::Rebuild)),
        (DeltaFormat::Float32, compute),
    ];
    if engine.caps().transform_feedback.is_some() {
        list.push((DeltaFormat::Snorm16, UpdateDesc::new(UpdatePath::Feedback, BatchSize::Targets(4))));
    }
    list
}

/// The weights of a frame, as an animation has them.
fn weights(frame: usize) -> Vec<f32> {
    (0..TARGETS).map(|t| ((t * 13 + frame * 5) % 17) as f32 / 16.0 - 0.4).collect()
}

/// Away and back, and a while at rest: pixels a unit.
const CAMERA: [f32; 10] = [30.0, 8.0, 2.0, 0.5, 0.1, 0.1, 0.4, 3.0, 10.0, 30.0];

fn level() -> Level {
    // Wide fades, so that they come and go in a few frames.
    Level::new(LevelDesc::default().pixels(8.0).fade(6.0))
}

#[test]
fn what_is_kept_is_applied_on_every_path() {
    on_every_device(|headless, engine| {
        let mesh = testing::mesh(700, TARGETS);
        let importance = Importance::of(&mesh, &[]).expect("an order");
        for (format, desc) in paths(engine) {
            let packed = gpu::packed(engine, &mesh, format);
            let mut crowd = HeadlessCrowd::new(headless, &packed, &CrowdDesc::new(desc)).expect("a crowd");
            let (mut level, mut levels) = (level(), vec![]);
            for (frame, pixels_per_unit) in CAMERA.into_iter().enumerate() {
                let whole = weights(frame);
                let mut kept = whole.clone();
                levels.push(level.step(&importance, pixels_per_unit, Some(&whole)));
                importance.apply(levels[frame], &mut kept).expect("as many weights");
                crowd.step(&[&kept]).expect("a step");
                // Of what the level says, target by target: not by `apply`.
                let expected: Vec<f32> = (0..TARGETS).map(|t| whole[t] * importance.factor(t, levels[frame])).collect();
                let error = compare(&crowd.read_pose(0).expect("a pose"), &gpu::reference(&packed, &desc, &expected));
                let bound = POSITION * f64::from(packed.layout().diagonal);
                assert!(error.within(bound, NORMAL), "{desc:?} frame {frame} at {}: {error:?}", levels[frame]);
            }
            let parts = levels.iter().filter(|level| level.fract() != 0.0).count();
            let [fewest, most] = [f32::min, f32::max].map(|f| levels.iter().copied().reduce(f).expect("levels"));
            assert!(parts > 2 && fewest < 3.0 && most > 10.0, "{levels:?}");
        }
    });
}

/// On the path cpu, of every format; and how far the pose is from that of all weights.
#[test]
fn poses_on_the_cpu_are_off_by_no_more_than_the_pixels() {
    let mesh = testing::mesh(700, TARGETS);
    for format in DeltaFormat::ALL {
        let packed = Arc::new(PackedMesh::pack(&mesh, &PackDesc::new(format)).expect("a mesh that packs"));
        let importance = Importance::of_packed(&packed, &[]).expect("an order");
        let update = UpdateDesc::new(UpdatePath::Cpu, BatchSize::All);
        let mut crowd = CpuCrowd::new(packed.clone(), update, 1, 1).expect("a crowd");
        let mut level = level();
        for (frame, pixels_per_unit) in CAMERA.into_iter().enumerate() {
            let whole = weights(frame);
            let mut kept = whole.clone();
            level.cut();
            let at = level.step(&importance, pixels_per_unit, Some(&whole));
            importance.apply(at, &mut kept).expect("as many weights");
            crowd.set_weights(0, &kept).expect("weights");
            crowd.update();
            let pose = packed.layout().to_user_order(&crowd.pose(0).expect("a pose"));
            let rounding = 1e-3 * f64::from(mesh.diagonal);
            let off = compare(&pose, &evaluate_unpacked(&mesh, &whole)).position;
            assert!(off * f64::from(pixels_per_unit) <= 4.0 + rounding, "{format:?} frame {frame}: {off}");
            // Something is dropped, and that can be seen.
            assert!(at >= 11.0 || off > rounding, "{format:?} frame {frame}: {off}, {at} kept");
        }
    }
}

/// Dropping a target is one more delta weight, and once it is dropped, it costs nothing; nor does a camera that stands still, or
/// trembles.
#[test]
fn a_target_that_is_dropped_is_a_delta_weight() {
    let mesh = testing::mesh(700, TARGETS);
    let packed = Arc::new(PackedMesh::pack(&mesh, &PackDesc::new(DeltaFormat::Fast)).expect("a mesh that packs"));
    let importance = Importance::of_packed(&packed, &[]).expect("an order");
    let update = UpdateDesc::new(UpdatePath::Cpu, BatchSize::All);
    let mut crowd = CpuCrowd::new(packed.clone(), update, 1, 1).expect("a crowd");
    let mut coefficients = |level: f32, weights: &[f32]| {
        let mut kept = weights.to_vec();
        importance.apply(level, &mut kept).expect("as many weights");
        crowd.set_weights(0, &kept).expect("weights");
        let stats = crowd.update();
        (stats.coefficients, stats.bytes_moved)
    };
    let mut whole = vec![0.5; TARGETS];
    assert_eq!(coefficients(12.0, &whole).0, 12);
    assert_eq!(coefficients(8.0, &whole).0, 4);
    assert_eq!(coefficients(7.75, &whole).0, 1);
    assert_eq!(coefficients(7.75, &whole), (0, 0));
    // All weights move; those of dropped targets are of no concern.
    whole.fill(0.6);
    assert_eq!(coefficients(7.0, &whole).0, 8);
    whole.fill(0.7);
    assert_eq!(coefficients(7.0, &whole).0, 7);

    let mut level = level();
    let still: Vec<_> = [2.0, 2.1, 1.9, 2.05, 2.0, 1.95, 2.0]
        .into_iter()
        .map(|pixels| coefficients(level.step(&importance, pixels, Some(&whole)), &whole))
        .collect();
    assert!(still[2..].iter().all(|did| *did == (0, 0)), "{still:?}");
}
