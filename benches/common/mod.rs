//! What benches of devices share.

/// The middle of some values, of which there is at least one.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Numbers in 0..1, the same everywhere.
pub fn noise(i: usize) -> f32 {
    let x = (i as u32).wrapping_mul(0x9E37_79B9);
    ((x ^ x >> 15).wrapping_mul(0x85EB_CA6B) >> 8) as f32 / (1 << 24) as f32
}
