//! Safe code without undefined behaviour: threads, tickets, recorded updates, failing steps, and memory limits.

use crate::prelude::*;
use std::slice::from_mut;

#[test]
fn what_may_not_be_shared_between_threads() {
    fn sent<T: Send>() {}
    sent::<Headless>();

    /// Ambiguous, and so a compile error, for a type that is `Sync`.
    trait NotSync<Which> {
        fn check() {}
    }
    impl<T: ?Sized> NotSync<()> for T {}
    impl<T: ?Sized + Sync> NotSync<u8> for T {}
    <Headless as NotSync<_>>::check();
    <HeadlessCrowd<'static> as NotSync<_>>::check();
}

/// Two devices of the same driver, with a crowd on each.
#[test]
fn a_step_that_fails_half_way_leaves_every_crowd_as_it_was() {
    for driver in drivers() {
        let devices = [(); 2].map(|()| gpu::device(&driver, false, None));
        let mesh = gpu::packed(devices[0].engine(), &testing::mesh(300, 8), DeltaFormat::Fast);
        let mut both = devices.each_ref().map(|headless| gpu::crowd(headless, &mesh, UpdateDesc::blocks()));
        let asked = [0.7; 8];
        both[0].step(&[&[0.0; 8]]).expect("a step");
        let error =
            HeadlessCrowd::step_together(&mut both, &[&asked, &asked], Draws::default()).expect_err("two devices");
        assert!(error.to_string().contains("several devices"), "{error}");
        both[0].step(&[&asked]).expect("a step");
        gpu::assert_right(&mut both[0], 0, &mesh, &asked);
    }
}

#[test]
fn a_panic_between_planning_and_recording_takes_the_update_back() {
    on_every_device(|headless, engine| {
        let mesh = gpu::packed(engine, &testing::mesh(300, 8), DeltaFormat::Fast);
        let mut crowd = gpu::crowd(headless, &mesh, UpdateDesc::blocks());
        crowd.step(&[&[0.0; 8]]).expect("a step");
        let asked = [0.7; 8];
        // SAFETY: the commands are not changed; the caller catches the panic.
        let failed = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| unsafe {
            HeadlessCrowd::step_tampered(from_mut(&mut crowd), &[&asked], |_| panic!("between planning and recording"))
        }));
        assert!(failed.is_err());
        assert!(crowd.crowd().pose(0).is_err(), "what was planned is not taken as done");
        crowd.step(&[&asked]).expect("a step");
        gpu::assert_right(&mut crowd, 0, &mesh, &asked);
    });
}

#[test]
fn what_does_not_fit_comes_out_as_nan() {
    let mesh = testing::mesh(100, 4);
    for format in [DeltaFormat::Snorm16, DeltaFormat::Fast] {
        let packed = PackedMesh::pack(&mesh, &PackDesc::new(format)).expect("a mesh");
        let kept = packed.layout().to_user_order(&packed.base()[..6 * 10]);
        assert_eq!(kept.iter().filter(|number| number.is_nan()).count(), 6 * 90, "{format:?}");
        packed.for_each_delta(4, |_, _| panic!("there is no such target"));
        assert!(packed.measure_error(&mesh).within(1.0, 180.0));
        for other in [testing::mesh(99, 4), testing::mesh(100, 3)] {
            assert!(!packed.measure_error(&other).within(f64::INFINITY, f64::INFINITY));
        }
    }
}
