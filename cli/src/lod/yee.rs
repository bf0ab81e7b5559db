//! Visible differences between two pictures, per pixel: Hector Yee, "A Perceptual Metric for Production Testing",
//! Journal of Graphics Tools 9(4), 2004, written from its formulas and those that it cites. (No crate implements it:
//! `perceptualdiff` is a program.)
//!
//! A pixel differs visibly if its luminances differ by more than the threshold at the surrounding luminance (TVI) times
//! the masking by contrast in its neighbourhood, or if its colours do. Contrast is evaluated in bands of an octave
//! each; the eye's sensitivity depends on the band (CSF), and a band masks differences in itself.

use super::picture::blurred;
use deltamorph_render::Picture;

/// Resolution of pictures on a screen of 0.7 m across and 3,840 pixels that is seen from 0.7 m.
const PIXELS_PER_DEGREE: f64 = 67.0;
/// Luminance of white, in cd/m².
const WHITE: f64 = 100.0;
/// Levels of the pyramid; a band is the difference of two adjacent levels, relative to the next one.
const LEVELS: usize = 8;
const BANDS: usize = LEVELS - 2;
/// Lower luminances are clamped to it.
const DARK: f64 = 1e-5;
/// Most that contrast raises the threshold; it never lowers it.
const MOST_HIDDEN: f64 = 10.0;

/// The result of a comparison.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// Pixels in all.
    pub pixels: usize,
    /// Pixels that visibly differ.
    pub visible: usize,
    /// How close the differences of other pixels are to visible, on average: 0 to 1.
    pub below: f64,
}

impl Seen {
    /// Share of the pixels that visibly differ, plus less than half a pixel in all for differences below the threshold,
    /// which breaks ties.
    pub fn graded(&self) -> f64 {
        (self.visible as f64 + self.below / 2.0) / self.pixels.max(1) as f64
    }
}

/// Compares two pictures of one size.
pub fn yee(a: &Picture, b: &Picture) -> Seen {
    let [from, to] = [a, b].map(Layers::new);
    // Cycles per degree of each band; the finest has two pixels per cycle.
    let frequencies: [f64; BANDS] = std::array::from_fn(|i| 0.5 * PIXELS_PER_DEGREE / f64::from(1u32 << i));
    // The peak sensitivity: a band masks more, the less sensitive the eye is to it.
    let peak = (1..400).map(|i| sensitivity(f64::from(i) * 0.05, WHITE)).fold(0.0, f64::max);
    let elevations = frequencies.map(|f| peak / sensitivity(f, WHITE));
    // Eyes adapt to the mean over about a degree: level i extends 2^i pixels in each direction.
    let adapted = (0..LEVELS - 1).find(|i| f64::from(2u32 << i) >= PIXELS_PER_DEGREE).unwrap_or(LEVELS - 1);
    let mut visible = 0;
    let mut below = 0.0;
    let pixels = from.levels[0].len();
    for i in (0..pixels).filter(|i| from.levels[0][*i] != to.levels[0][*i] || from.colours[*i] != to.colours[*i]) {
        let around = ((from.levels[adapted][i] + to.levels[adapted][i]) / 2.0).max(DARK);
        let mut hidden = 0.0;
        let mut sum = 0.0;
        for band in 0..BANDS {
            let detail = |of: &Layers| (of.levels[band][i] - of.levels[band + 1][i]).abs();
            let base = from.levels[band + 2][i].abs().max(to.levels[band + 2][i].abs()).max(DARK);
            let contrast = detail(&from).max(detail(&to)) / base;
            hidden += contrast * elevations[band] * masking(contrast * sensitivity(frequencies[band], around));
            sum += contrast;
        }
        let factor = if sum > DARK { (hidden / sum).clamp(1.0, MOST_HIDDEN) } else { 1.0 };
        let light = (from.levels[0][i] - to.levels[0][i]).abs() / (factor * threshold(around));
        let [[a0, b0], [a1, b1]] = [from.colours[i], to.colours[i]];
        // In the dark, colours are harder to tell apart.
        let seen = if around < 10.0 { (around / 10.0).powi(2) } else { 1.0 };
        let colour = ((a0 - a1).powi(2) + (b0 - b1).powi(2)) * seen / factor;
        let ratio = light.max(colour);
        if ratio > 1.0 {
            visible += 1;
        } else {
            below += ratio;
        }
    }
    Seen { pixels, visible, below: below / (pixels - visible).max(1) as f64 }
}

/// Contrast sensitivity at a number of cycles per degree, adapted to a luminance in cd/m²: Barten 1989, Yee's equation
/// 4.
fn sensitivity(frequency: f64, luminance: f64) -> f64 {
    let a = 440.0 * (1.0 + 0.7 / luminance).powf(-0.2);
    let b = 0.3 * (1.0 + 100.0 / luminance).powf(0.15);
    a * frequency * (-b * frequency).exp() * (1.0 + 0.06 * (b * frequency).exp()).sqrt()
}

/// Elevation of the threshold by a contrast, given in multiples of the threshold: Daly 1993.
fn masking(contrast: f64) -> f64 {
    (1.0 + (0.0153 * (392.498 * contrast).powf(0.7)).powf(4.0)).powf(0.25)
}

/// Threshold versus intensity: the smallest visible difference of luminance, in cd/m², on a field of a luminance in
/// cd/m² (Ward Larson, Rushmeier and Piatko 1997, after Ferwerda).
fn threshold(luminance: f64) -> f64 {
    let l = luminance.log10();
    let log = match l {
        _ if l < -3.94 => -2.86,
        _ if l < -1.44 => (0.405 * l + 1.6).powf(2.18) - 2.86,
        _ if l < -0.0184 => l - 0.395,
        _ if l < 1.9 => (0.249 * l + 0.65).powf(2.7) - 0.72,
        _ => l - 1.255,
    };
    10f64.powf(log)
}

/// A picture as perceived.
struct Layers {
    /// Luminances in cd/m², each level blurred by an octave more than the previous one.
    levels: [Vec<f64>; LEVELS],
    /// a* and b* of CIE L*a*b*.
    colours: Vec<[f64; 2]>,
}

impl Layers {
    fn new(picture: &Picture) -> Self {
        let linear: [f64; 256] = std::array::from_fn(|v| {
            let v = v as f64 / 255.0;
            if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
        });
        let xyz = |c: &[u8]| {
            let [r, g, b] = [c[0], c[1], c[2]].map(|v| linear[v as usize]);
            // sRGB, IEC 61966-2-1; each row divided by the white point (D65), so that white is 1, 1, 1.
            [
                (0.4124 * r + 0.3576 * g + 0.1805 * b) / 0.9505,
                0.2126 * r + 0.7152 * g + 0.0722 * b,
                (0.0193 * r + 0.1192 * g + 0.9505 * b) / 1.089,
            ]
        };
        let root = |v: f64| if v > 0.008856 { v.cbrt() } else { 7.787 * v + 16.0 / 116.0 };
        let colour = |[x, y, z]: [f64; 3]| [500.0 * (root(x) - root(y)), 200.0 * (root(y) - root(z))];
        let colours = picture.rgba.chunks_exact(4).map(|c| colour(xyz(c))).collect();
        let mut level: Vec<f64> = picture.rgba.chunks_exact(4).map(|c| xyz(c)[1] * WHITE).collect();
        let levels = std::array::from_fn(|i| {
            // The next level of a pyramid (Burt and Adelson 1983, a = 0.4) at full resolution.
            let next = blurred(&level, picture.size[0] as usize, [0.05, 0.25, 0.4, 0.25, 0.05], 1 << i, false);
            std::mem::replace(&mut level, next)
        });
        Self { levels, colours }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(grey: u8, change: impl Fn(usize, usize) -> u8) -> Picture {
        let at = |i: usize| grey + change(i % 48, i / 48);
        Picture { size: [48, 40], rgba: (0..48 * 40).flat_map(|i| [at(i), at(i), at(i), 255]).collect() }
    }

    #[test]
    fn formulas_have_the_values_that_papers_plot() {
        // At 100 cd/m², the eye distinguishes about 6%, and is most sensitive near 3 to 4 cycles per degree.
        assert!((threshold(100.0) - 10f64.powf(0.745)).abs() < 1e-12);
        assert!((threshold(1e-5) - 10f64.powf(-2.86)).abs() < 1e-12);
        let at = |f: f64| sensitivity(f, 100.0);
        assert!(at(3.2) > at(1.0) && at(3.2) > at(10.0) && at(3.2) > 200.0 && at(33.5) < 0.1 * at(3.2));
        assert!((masking(0.0) - 1.0).abs() < 1e-12 && masking(10.0) > 3.0 * masking(1.0));
    }

    #[test]
    fn what_is_below_the_threshold_is_not_counted_and_what_is_above_it_is() {
        let plain = flat(128, |_, _| 0);
        let equal = yee(&plain, &plain);
        let pixels = 48 * 40;
        assert_eq!((equal, equal.graded()), (Seen { pixels, visible: 0, below: 0.0 }, 0.0));
        // Luminance 21.6; without contrast only the threshold decides: 2.0 cd/m², which is 6 steps of sRGB.
        let luminance = |v: f64| 100.0 * ((v / 255.0 + 0.055) / 1.055).powf(2.4);
        for step in [1u8, 4, 8, 40] {
            let seen = yee(&plain, &flat(128 + step, |_, _| 0));
            let [from, to] = [128.0, 128.0 + f64::from(step)].map(luminance);
            let over = (to - from) / threshold((from + to) / 2.0);
            assert_eq!((seen.visible, over > 1.0), (if over > 1.0 { pixels } else { 0 }, step > 5), "{step}: {over}");
            assert!(over > 1.0 || (seen.below - over).abs() < 1e-3 * over, "{step}: {seen:?} {over}");
        }
        // A bright square counts about as many pixels as it has, in either order of the pictures.
        let square = flat(60, |x, y| if (10..26).contains(&x) && (8..24).contains(&y) { 120 } else { 0 });
        let base = flat(60, |_, _| 0);
        let seen = yee(&base, &square);
        assert_eq!((seen.visible, seen), (256, yee(&square, &base)));
        // More pixels score higher; of equally many, those closer to visible.
        let faint = |step: u8| yee(&plain, &flat(128, |x, _| if x < 20 { step } else { 0 })).graded();
        assert!(faint(0) < faint(1) && faint(1) < faint(2) && faint(2) < seen.graded());
        assert!(faint(2) * (pixels as f64) < 0.5);
    }

    #[test]
    fn contrast_hides_differences() {
        let stripes = |more: u8| flat(100 + more, |x, _| if x % 2 == 0 { 100 } else { 0 });
        let plain = |more: u8| flat(150 + more, |_, _| 0);
        assert_eq!(yee(&plain(0), &plain(14)).visible, 48 * 40);
        assert_eq!(yee(&stripes(0), &stripes(14)).visible, 0);
    }

    #[test]
    fn colours_of_one_luminance_are_told_apart() {
        let colour = |[r, g, b]: [u8; 3]| Picture { size: [16, 16], rgba: [r, g, b, 255].repeat(256) };
        let luminance = |p: &Picture| Layers::new(p).levels[0][0];
        let red = colour([200, 100, 100]);
        let green = colour([90, 139, 100]);
        assert!((luminance(&red) - luminance(&green)).abs() < 0.5 * threshold(luminance(&red)));
        assert_eq!(yee(&red, &green).visible, 256);
    }
}
