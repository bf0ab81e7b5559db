//! Numbers as stored in glTF.

use crate::file::{F32, I8, I16, U8, bytes};

/// An array in the file's format, and its values: normalised integers, by glTF 2.0, 3.11.
#[derive(Clone)]
pub struct Numbers {
    pub component: u32,
    pub normalised: bool,
    pub width: usize,
    pub bytes: Vec<u8>,
    values: Vec<f64>,
}

impl Numbers {
    pub fn floats(width: usize, values: impl IntoIterator<Item = f64>) -> Self {
        let values: Vec<f32> = values.into_iter().map(|x| x as f32).collect();
        let exact = values.iter().map(|x| f64::from(*x)).collect();
        Self { component: F32, normalised: false, width, bytes: bytes(&values), values: exact }
    }

    /// Makes numbers that are in no file.
    pub fn exact(width: usize, values: Vec<f64>) -> Self {
        Self { component: F32, normalised: false, width, bytes: vec![], values }
    }

    /// Makes integers: each of `values` divided by the value of 1, and rounded.
    pub fn integers(component: u32, normalised: bool, width: usize, values: impl IntoIterator<Item = f64>) -> Self {
        let one = match (normalised, component) {
            (false, _) => 1.0,
            (true, I8) => 127.0,
            (true, U8) => 255.0,
            (true, I16) => 32767.0,
            (true, _) => 65535.0,
        };
        let whole: Vec<i64> = values.into_iter().map(|x| (x * one).round() as i64).collect();
        let size = size_of_component(component);
        // Vectors begin at multiples of four bytes, as required for vertices.
        let padding = if width == 1 { 0 } else { (width * size).next_multiple_of(4) - width * size };
        let element = |e: &[i64]| {
            let numbers = e.iter().flat_map(|x| x.to_le_bytes().into_iter().take(size));
            numbers.chain(vec![0; padding]).collect::<Vec<u8>>()
        };
        let bytes = whole.chunks_exact(width).flat_map(element).collect();
        let values = whole.iter().map(|x| *x as f64 / one).collect();
        Self { component, normalised, width, bytes, values }
    }

    /// Returns the same numbers as elements of another width.
    pub fn with_width(&self, width: usize) -> Self {
        Self { width, ..self.clone() }
    }

    /// Returns the bytes from element to element.
    pub fn stride(&self) -> usize {
        self.bytes.len() / self.count()
    }

    /// Returns whether there is padding between elements.
    pub fn is_padded(&self) -> bool {
        self.stride() > self.width * size_of_component(self.component)
    }

    pub fn at(&self, i: usize) -> &[f64] {
        &self.values[i * self.width..][..self.width]
    }

    pub fn count(&self) -> usize {
        self.values.len() / self.width
    }
}

fn size_of_component(component: u32) -> usize {
    match component {
        I8 | U8 => 1,
        F32 => 4,
        _ => 2,
    }
}
