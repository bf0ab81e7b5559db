use super::geometry::{Loss, hausdorff, tree};
use super::picture::{mean_square as picture_mse, ssim};
use super::yee::yee;
use deltamorph::lod::mean_square;
use deltamorph::reference::evaluate_unpacked;
use deltamorph::{KeptMesh, Tolerance, WeightClip};
use deltamorph_head::{HeadDesc, head};
use deltamorph_render::Picture;
use glam::Vec3;

/// A small head; its first target moves every vertex by `shift`, its second one twice as far.
fn shifted(shift: Vec3) -> KeptMesh {
    let source = head(&HeadDesc { vertices: 1200, targets: 6, ..Default::default() });
    let mut mesh = source.kept(Tolerance::ZERO).expect("a mesh");
    for (target, times) in mesh.targets.iter_mut().zip([1.0, 2.0]) {
        target.vertices = (0..mesh.positions.len() as u32).collect();
        target.positions = vec![shift * times; mesh.positions.len()];
        target.normals = vec![Vec3::ZERO; mesh.positions.len()];
    }
    mesh
}

#[test]
fn known_shifts_have_known_scores_and_twice_as_far_ranks_higher() {
    let mesh = shifted(Vec3::X * 1000.0);
    // Farther than the size of the head: the nearest of the extreme vertices is known.
    let base = tree(&mesh.positions);
    let brute = |target: usize| {
        let pose: Vec<Vec3> = mesh.positions.iter().map(|p| *p + mesh.targets[target].positions[0]).collect();
        let nearest = |p: &Vec3, of: &[Vec3]| of.iter().map(|q| p.distance(*q)).fold(f32::INFINITY, f32::min);
        let there = pose.iter().map(|p| nearest(p, &mesh.positions)).fold(0.0, f32::max);
        f64::from(mesh.positions.iter().map(|p| nearest(p, &pose)).fold(there, f32::max))
    };
    for target in [0, 1] {
        let found = hausdorff(&mesh, &base, &mesh.targets[target]);
        let exact = brute(target);
        assert!((found - exact).abs() <= 1e-5 * exact, "{found} {exact}");
    }
    let scores: Vec<f64> = mesh.targets.iter().map(|t| mean_square(&mesh, t)).collect();
    assert!((scores[0] - 1e6).abs() < 1e-3 && (scores[1] - 4e6).abs() < 1e-3, "{scores:?}");
    // Less than half of the distance between any two vertices: every vertex stays nearest to its origin.
    let gap = (mesh.positions.iter().enumerate())
        .flat_map(|(i, p)| mesh.positions[..i].iter().map(move |q| p.distance(*q)).filter(|d| *d > 0.0))
        .fold(f32::INFINITY, f32::min);
    let mesh = shifted(Vec3::Y * gap * 0.2);
    let base = tree(&mesh.positions);
    for (target, times) in [(0, 1.0), (1, 2.0)] {
        let found = hausdorff(&mesh, &base, &mesh.targets[target]);
        let exact = f64::from(gap * 0.2) * times;
        assert!((found - exact).abs() <= 1e-2 * exact, "{found} {exact}");
    }
}

#[test]
fn losses_are_those_of_poses_evaluated_in_float64() {
    let mesh =
        head(&HeadDesc { vertices: 1200, targets: 6, ..Default::default() }).kept(Tolerance::ZERO).expect("a mesh");
    let names: Vec<String> = mesh.targets.iter().map(|t| t.name.clone()).collect();
    let values: Vec<f32> = (0..6 * 5).map(|i| ((i * 7) % 11) as f32 / 10.0 - 0.2).collect();
    let clip = WeightClip { name: "clip".into(), names: names.clone(), fps: 30.0, values, ..Default::default() };
    let clip = clip.bind(&names.iter().map(String::as_str).collect::<Vec<_>>()).expect("bound");
    let loss = Loss::new(&mesh, std::slice::from_ref(&clip));
    for bits in [0b0, 0b101, 0b110011, 0b111111] {
        let kept: Vec<bool> = (0..6).map(|t| bits >> t & 1 == 1).collect();
        let mut sum = 0.0;
        let mut count = 0;
        for whole in clip.frames() {
            let part: Vec<f32> = whole.iter().zip(&kept).map(|(w, k)| if *k { *w } else { 0.0 }).collect();
            let [whole, part] = [whole, part].map(|weights| evaluate_unpacked(&mesh, &weights));
            for (a, b) in whole.chunks_exact(6).zip(part.chunks_exact(6)) {
                sum += (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>();
                count += 1;
            }
        }
        let exact = (sum / f64::from(count)).sqrt();
        assert!((loss.of(&kept) - exact).abs() <= 1e-6 * exact.max(1e-6), "{bits:b}: {} {exact}", loss.of(&kept));
    }
}

#[test]
fn equal_pictures_are_equal_to_every_metric_and_known_differences_are_found() {
    let size = [32, 24];
    let noise = |seed: u64| {
        let mut rng = deltamorph_head::Rng::new(seed, 0);
        let mut pixel = || [rng.below(256) as u8, rng.below(256) as u8, rng.below(256) as u8, 255];
        Picture { size, rgba: (0..32 * 24).flat_map(|_| pixel()).collect() }
    };
    let a = noise(1);
    let b = noise(2);
    assert!((ssim(&a, &a) - 1.0).abs() < 1e-12 && picture_mse(&a, &a) == 0.0 && yee(&a, &a).graded() == 0.0);
    assert!(ssim(&a, &b) < 0.2 && picture_mse(&a, &b) > 0.1 && yee(&a, &b).graded() > 0.1);
    // For constant pictures, only the luminance term remains: (2 x y + c) / (x² + y² + c).
    let flat = |v: u8| Picture { size, rgba: [v, v, v, 255].repeat(32 * 24) };
    let c = (0.01f64 * 255.0).powi(2);
    let exact = (2.0 * 50.0 * 200.0 + c) / (50.0f64.powi(2) + 200.0f64.powi(2) + c);
    assert!((ssim(&flat(50), &flat(200)) - exact).abs() < 1e-9);
    assert!((picture_mse(&flat(0), &flat(51)) - 0.04).abs() < 1e-12);
}
