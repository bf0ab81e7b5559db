//! The transfer function of sRGB (IEC 61966-2-1).

/// The linear value, 0 to 1, of a component of 8 bits.
pub fn decoded(srgb: u8) -> f32 {
    let v = f32::from(srgb) / 255.0;
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// The component of 8 bits nearest to a linear value; values beyond 0 to 1 are clamped.
pub fn encoded(linear: f32) -> u8 {
    let v = linear.clamp(0.0, 1.0);
    let srgb = if v < 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    (srgb * 255.0).round() as u8
}
