//! Decoders of EXT_meshopt_compression, from the text of the extension: its appendix A (bitstream) for the three modes,
//! appendix B for the filters. `None` is data that is cut off or not of the mode.

/// Decode `count` elements of `size` bytes. What is refused is said in words that follow a place.
pub fn decode(data: &[u8], count: usize, size: usize, mode: &str, filter: &str) -> Result<Vec<u8>, String> {
    // No mode makes more than 64 bytes of one: 2 bits stand for 16 bytes without change.
    let total = count.checked_mul(size).filter(|total| total / 64 <= data.len());
    let Some(total) = total else {
        return Err(format!("{count} elements of {size} bytes, more than {} compressed bytes can hold", data.len()));
    };
    let fits = match (mode, filter) {
        ("ATTRIBUTES", "" | "NONE" | "EXPONENTIAL") => size.is_multiple_of(4) && (4..=256).contains(&size),
        ("ATTRIBUTES", "OCTAHEDRAL") => size == 4 || size == 8,
        ("ATTRIBUTES", "QUATERNION") => size == 8,
        ("TRIANGLES", "" | "NONE") => (size == 2 || size == 4) && count.is_multiple_of(3),
        ("INDICES", "" | "NONE") => size == 2 || size == 4,
        _ => false,
    };
    if !fits {
        return Err(format!(
            "{count} elements of {size} bytes in mode '{mode}' with filter '{filter}', which is not valid"
        ));
    }
    let decoded = match mode {
        "TRIANGLES" => triangles(data, count, total).map(|indices| narrow(&indices, size)),
        "INDICES" => indices(data, count).map(|indices| narrow(&indices, size)),
        _ => attributes(data, count, size),
    };
    let mut bytes = decoded.ok_or_else(|| format!("data that is cut off, or not of mode {mode}"))?;
    match (filter, size) {
        ("OCTAHEDRAL", 4) => bytes.chunks_exact_mut(4).for_each(|v| {
            let [x, y, one] = [v[0], v[1], v[2]].map(|b| f32::from(b as i8));
            octahedral(x, y, one, 127.0).iter().zip(v).for_each(|(value, byte)| *byte = *value as i8 as u8);
        }),
        ("OCTAHEDRAL", _) => bytes.chunks_exact_mut(8).for_each(|v| {
            let [x, y, one, w] = shorts(v);
            let [x, y, z] = octahedral(x.into(), y.into(), one.into(), 32767.0).map(|value| value as i16);
            store(v, [x, y, z, w]);
        }),
        ("QUATERNION", _) => bytes.chunks_exact_mut(8).for_each(|v| store(v, quaternion(shorts(v)))),
        ("EXPONENTIAL", _) => bytes.chunks_exact_mut(4).for_each(|v| {
            let bits = i32::from_le_bytes([v[0], v[1], v[2], v[3]]);
            let value = f64::from(bits << 8 >> 8) * f64::from(bits >> 24).exp2();
            v.copy_from_slice(&(value as f32).to_le_bytes());
        }),
        _ => {}
    }
    Ok(bytes)
}

/// Elements in a group.
const GROUP: usize = 16;

fn attributes(data: &[u8], count: usize, size: usize) -> Option<Vec<u8>> {
    let (header, mut rest) = data.split_first()?;
    let tail = rest.len().checked_sub(size.max(32))?;
    let last = rest.len() - size;
    let mut before = rest[last..].to_vec();
    rest = &rest[..tail];
    if *header != 0xa0 {
        return None;
    }
    let mut out = vec![0; count * size];
    let block = (8192 / size / GROUP * GROUP).min(256);
    for elements in out.chunks_mut(block * size) {
        let groups = (elements.len() / size).div_ceil(GROUP);
        for (byte, before) in before.iter_mut().enumerate() {
            let modes = rest.split_off(..groups.div_ceil(4))?;
            for group in 0..groups {
                let deltas = deltas(&mut rest, modes[group / 4] >> (group % 4 * 2) & 3)?;
                let places = elements[byte..].iter_mut().step_by(size).skip(group * GROUP);
                for (place, delta) in places.zip(deltas) {
                    *before = before.wrapping_add(delta >> 1 ^ (delta & 1).wrapping_neg());
                    *place = *before;
                }
            }
        }
    }
    rest.is_empty().then_some(out)
}

/// The zigzag deltas of a group: none, of 2 or 4 bits with a byte for those that do not fit, or bytes.
fn deltas(rest: &mut &[u8], mode: u8) -> Option<[u8; GROUP]> {
    let mut out = [0; GROUP];
    let bits = match mode {
        0 => return Some(out),
        1 => 2,
        2 => 4,
        _ => {
            out.copy_from_slice(rest.split_off(..GROUP)?);
            return Some(out);
        }
    };
    let packed = rest.split_off(..GROUP * bits / 8)?;
    let all = (1u8 << bits) - 1;
    for (i, out) in out.iter_mut().enumerate() {
        let bit = i * bits;
        *out = packed[bit / 8] >> (8 - bits - bit % 8) & all;
        if *out == all {
            *out = *rest.split_off_first()?;
        }
    }
    Some(out)
}

/// A queue of 16: 0 is what was pushed last.
struct Recent<T>([T; 16], usize);

impl<T: Copy> Recent<T> {
    fn push(&mut self, value: T) {
        self.0[self.1 % 16] = value;
        self.1 = (self.1 + 1) % 16;
    }

    fn get(&self, back: usize) -> T {
        self.0[(self.1 + 31 - back) % 16]
    }
}

/// What triangles are decoded with.
struct Triangles<'a> {
    extra: &'a [u8],
    next: u32,
    last: u32,
    edges: Recent<[u32; 2]>,
    vertices: Recent<u32>,
}

impl Triangles<'_> {
    fn take_next(&mut self) -> u32 {
        let next = self.next;
        self.next = next.wrapping_add(1);
        next
    }

    fn explicit(&mut self) -> Option<u32> {
        let v = leb128(&mut self.extra)?;
        self.last = self.last.wrapping_add(v >> 1 ^ (v & 1).wrapping_neg());
        Some(self.last)
    }

    /// A vertex that four bits name, and whether it goes into the queue.
    fn named(&mut self, bits: u8, may_be_explicit: bool) -> Option<(u32, bool)> {
        Some(match bits {
            0 => (self.take_next(), true),
            15 if may_be_explicit => (self.explicit()?, true),
            _ => (self.vertices.get(usize::from(bits) - 1), false),
        })
    }

    fn triangle(&mut self, code: u8, table: &[u8]) -> Option<[u32; 3]> {
        let (high, low) = (code >> 4, code & 15);
        if high < 15 {
            let [a, b] = self.edges.get(high.into());
            let (c, is_new) = match low {
                0 => (self.take_next(), true),
                13 | 14 => {
                    self.last = if low == 13 { self.last.wrapping_sub(1) } else { self.last.wrapping_add(1) };
                    (self.last, true)
                }
                15 => (self.explicit()?, true),
                _ => (self.vertices.get(low.into()), false),
            };
            self.edges.push([c, b]);
            self.edges.push([a, c]);
            if is_new {
                self.vertices.push(c);
            }
            return Some([a, b, c]);
        }
        let explicit = low >= 14;
        let names = if explicit { *self.extra.split_off_first()? } else { table[usize::from(low)] };
        if explicit && names == 0 {
            self.next = 0;
        }
        let a = if low == 15 { self.explicit()? } else { self.take_next() };
        let (b, b_is_new) = self.named(names >> 4, explicit)?;
        let (c, c_is_new) = self.named(names & 15, explicit)?;
        [[b, a], [c, b], [a, c]].into_iter().for_each(|edge| self.edges.push(edge));
        for (vertex, is_new) in [(a, true), (b, b_is_new), (c, c_is_new)] {
            if is_new {
                self.vertices.push(vertex);
            }
        }
        Some([a, b, c])
    }
}

fn triangles(data: &[u8], count: usize, total: usize) -> Option<Vec<u32>> {
    let (header, rest) = data.split_first()?;
    let (codes, rest) = rest.split_at_checked(count / 3)?;
    let (extra, table) = rest.split_at_checked(rest.len().checked_sub(16)?)?;
    if *header != 0xe1 {
        return None;
    }
    let (edges, vertices) = (Recent([[0; 2]; 16], 0), Recent([0; 16], 0));
    let mut state = Triangles { extra, next: 0, last: 0, edges, vertices };
    let mut out = Vec::with_capacity(total / 2);
    for &code in codes {
        out.extend(state.triangle(code, table)?);
    }
    state.extra.is_empty().then_some(out)
}

fn indices(data: &[u8], count: usize) -> Option<Vec<u32>> {
    let (header, rest) = data.split_first()?;
    let mut rest = rest.get(..rest.len().checked_sub(4)?)?;
    if *header != 0xd1 {
        return None;
    }
    let mut last = [0u32; 2];
    let mut out = Vec::with_capacity(count.min(data.len()));
    for _ in 0..count {
        let v = leb128(&mut rest)?;
        let last = &mut last[v as usize & 1];
        *last = last.wrapping_add(v >> 2 ^ (v >> 1 & 1).wrapping_neg());
        out.push(*last);
    }
    rest.is_empty().then_some(out)
}

/// An unsigned number in groups of seven bits, the lowest first.
fn leb128(rest: &mut &[u8]) -> Option<u32> {
    let mut value = 0u32;
    for shift in (0..35).step_by(7) {
        let byte = *rest.split_off_first()?;
        value |= u32::from(byte & 127) << shift;
        if byte < 128 {
            return Some(value);
        }
    }
    None
}

fn narrow(indices: &[u32], size: usize) -> Vec<u8> {
    indices.iter().flat_map(|index| index.to_le_bytes().into_iter().take(size)).collect()
}

fn shorts(v: &[u8]) -> [i16; 4] {
    [0, 2, 4, 6].map(|i| i16::from_le_bytes([v[i], v[i + 1]]))
}

fn store(v: &mut [u8], values: [i16; 4]) {
    v.chunks_exact_mut(2).zip(values).for_each(|(bytes, value)| bytes.copy_from_slice(&value.to_le_bytes()));
}

fn octahedral(x: f32, y: f32, one: f32, max: f32) -> [f32; 3] {
    let z = one - x.abs() - y.abs();
    let folded = z.min(0.0);
    let (x, y) = (x - folded.copysign(x), y - folded.copysign(y));
    let scale = max / (x * x + y * y + z * z).sqrt();
    [x, y, z].map(|c| (c * scale).round())
}

fn quaternion(v: [i16; 4]) -> [i16; 4] {
    let one = f32::from(v[3] | 3);
    let [x, y, z] = [v[0], v[1], v[2]].map(|c| f32::from(c) / one * std::f32::consts::FRAC_1_SQRT_2);
    let w = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
    let largest = (v[3] & 3) as usize;
    let mut out = [0; 4];
    for (i, c) in [w, x, y, z].into_iter().enumerate() {
        out[(largest + i) % 4] = (c * 32767.0).round() as i16;
    }
    out
}
