//! Numbers of 32 bits as the bytes of a file, and the reverse.

pub(super) fn read_u32s(bytes: &[u8]) -> Vec<u32> {
    bytes.as_chunks().0.iter().map(|b| u32::from_le_bytes(*b)).collect()
}

pub(super) fn read_f32s(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
}

pub(super) fn write_u32s(values: impl Iterator<Item = u32>) -> Vec<u8> {
    values.flat_map(u32::to_le_bytes).collect()
}

pub(super) fn write_f32s(values: &[f32]) -> Vec<u8> {
    write_u32s(values.iter().map(|v| v.to_bits()))
}
