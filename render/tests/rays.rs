//! Traced pictures of decoded poses equal rasterised ones, but at edges; see `examples/rays.rs`.

#[allow(dead_code, reason = "main of the example")]
#[path = "../examples/rays.rs"]
mod rays;

use deltamorph::{ErrorKind, PoseFormat};
use deltamorph_headless::{DeviceChoice, Headless, HeadlessDesc};
use rays::{Traced, run};
use std::io::Write;

#[test]
fn traced_pictures_differ_from_rasterised_ones_at_edges_alone() {
    let list = std::env::var("DELTAMORPH_TEST_DRIVERS").unwrap_or_else(|_| "llvmpipe".into());
    for driver in list.split(',') {
        let desc = HeadlessDesc::default().device(DeviceChoice::Name(driver.into())).validation(true);
        let headless = match Headless::new(&desc.ray_queries(true)) {
            Err(error) if error.kind() == ErrorKind::Unsupported => {
                // Past the test harness, which would keep it.
                writeln!(std::io::stderr(), "LEFT OUT: ray tracing: {error}").expect("a message");
                continue;
            }
            headless => headless.unwrap_or_else(|e| panic!("{driver}: {e}; run as ./with-vulkan cargo test")),
        };
        for pose in PoseFormat::ALL {
            let all = run(&headless, pose, [240, 320], 4).expect("pictures");
            let blocks = all[0].blocks;
            for (i, Traced { seen, different, .. }) in all.iter().enumerate() {
                println!("{driver}, {pose:?}, update {i}: {different:?} of {seen:?} pixels differ");
                assert!(seen[0] > 35_000 && seen[1] > seen[0] / 2, "{driver} {pose:?} {i}: {seen:?}");
                // Rasterisers round vertices to a fraction of a pixel, which moves few samples across an edge.
                assert!(different[0] < seen[0] / 25 && different[1] <= 4, "{driver} {pose:?} {i}: {different:?}");
            }
            // The clip begins at rest; then the face moves, and the back of the head is left alone.
            assert!(all[1].blocks == 0 && all[1].picture == all[0].picture, "{driver} {pose:?}");
            assert!(all[3..].iter().all(|later| later.blocks > 0 && later.blocks < blocks), "{driver} {pose:?}");
            assert!(all[4].picture != all[3].picture && all[3].picture != all[0].picture, "{driver} {pose:?}");
        }
        assert_eq!(headless.messages(), <[String; 0]>::default(), "{driver}");
    }
}
