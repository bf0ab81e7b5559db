//! Metrics of `lod` that compare pictures.

use deltamorph_render::Picture;

/// Mean squared difference of sRGB values, from 0 to 1, of opaque pictures.
pub fn mean_square(a: &Picture, b: &Picture) -> f64 {
    let squares = a.rgba.iter().zip(&b.rgba).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2));
    squares.sum::<f64>() / ((a.rgba.len() / 4 * 3).max(1) as f64 * 255.0 * 255.0)
}

/// Mean structural similarity of luma, at most 1 (Wang et al. 2004: Gaussian window of 11 × 11 pixels, σ = 1.5, K =
/// 0.01 and 0.03). Windows are cut off at the edges of the picture.
pub fn ssim(a: &Picture, b: &Picture) -> f64 {
    let luma = |p: &Picture| -> Vec<f64> {
        let of = |c: &[u8]| 0.299 * f64::from(c[0]) + 0.587 * f64::from(c[1]) + 0.114 * f64::from(c[2]);
        p.rgba.chunks_exact(4).map(of).collect()
    };
    let x = luma(a);
    let y = luma(b);
    let width = a.size[0] as usize;
    let gauss: [f64; 11] = std::array::from_fn(|i| (-(i as f64 - 5.0).powi(2) / (2.0 * 1.5 * 1.5)).exp());
    let blurred = |values: &[f64]| blurred(values, width, gauss, 1, true);
    let product = |p: &[f64], q: &[f64]| blurred(&p.iter().zip(q).map(|(p, q)| p * q).collect::<Vec<_>>());
    let means = [&x, &y].map(|p| blurred(p));
    let squares = [product(&x, &x), product(&y, &y), product(&x, &y)];
    let [c1, c2] = [0.01, 0.03].map(|k: f64| (k * 255.0).powi(2));
    let at = |i: usize| {
        let [mx, my] = [means[0][i], means[1][i]];
        let vx = squares[0][i] - mx * mx;
        let vy = squares[1][i] - my * my;
        let both = squares[2][i] - mx * my;
        (2.0 * mx * my + c1) * (2.0 * both + c2) / ((mx * mx + my * my + c1) * (vx + vy + c2))
    };
    (0..x.len()).map(at).sum::<f64>() / x.len().max(1) as f64
}

/// Weighted means around each pixel, of pixels `step` apart. Beyond the edges, pixels are left out if `cut`, else the
/// edge is repeated.
pub fn blurred<const N: usize>(values: &[f64], width: usize, weights: [f64; N], step: usize, cut: bool) -> Vec<f64> {
    let along = |values: &[f64], stride: usize, place: &dyn Fn(usize) -> usize, most: usize| -> Vec<f64> {
        let at = |i: usize| {
            let here = place(i);
            let first = N / 2 * step;
            let [mut sum, mut all] = [0.0; 2];
            for (tap, weight) in weights.iter().enumerate() {
                // Relative to the first tap of the first pixel.
                let there = here + tap * step;
                if !cut || (first..first + most).contains(&there) {
                    let there = there.saturating_sub(first).min(most - 1);
                    sum += weight * values[i + there * stride - here * stride];
                    all += weight;
                }
            }
            sum / all
        };
        (0..values.len()).map(at).collect()
    };
    let across = along(values, 1, &|i| i % width, width);
    along(&across, width, &|i| i / width, values.len() / width.max(1))
}
