//! A level of detail that follows a camera away from heads and back: no pixel pops.

#[path = "common/fly.rs"]
mod fly;

use deltamorph_headless::{DeviceChoice, Headless, HeadlessDesc};
use fly::{Fly, Frame};

/// A small wall: `examples/fly.rs` flies past a hundred heads.
#[test]
fn no_pixel_pops_and_bytes_fall_with_the_distance() {
    let desc = HeadlessDesc::default().device(DeviceChoice::Name("llvmpipe".into())).validation(true);
    let headless = Headless::new(&desc).expect("llvmpipe; run as ./with-vulkan cargo test");
    let fly = Fly { wall: [3, 3], vertices: 800, frames: 36, size: [72, 72], supersampling: 16, ..Fly::new() };
    let frames = fly.run(&headless, |_, _| ()).expect("pictures");
    let most = |of: &dyn Fn(&Frame) -> f32| frames.iter().map(of).fold(0.0, f32::max);
    let [pop, at_once, drift] = [most(&|f| f.pop[0]), most(&|f| f.pop[1]), most(&|f| f.drift)];
    assert!(pop > 0.0 && pop <= 2.0 && at_once > 2.0 * pop && drift > 0.0, "{frames:#?}");
    // Just after the middle, where the fade has caught up; updates of all targets move about as many bytes as before.
    let share = |frame: &Frame| frame.bytes[0] as f64 / frame.bytes[1] as f64;
    let [near, far] = [&frames[3], &frames[23]];
    assert!(share(far) < 0.5 * share(near) && far.bytes[1] * 2 > near.bytes[1], "{near:#?} {far:#?}");
    assert!(far.kept < near.kept && far.behind < 0.5 && far.distance > near.distance, "{near:#?} {far:#?}");
    assert!(far.head_pixels < near.head_pixels);
    assert_eq!(headless.messages(), <[String; 0]>::default());
}
