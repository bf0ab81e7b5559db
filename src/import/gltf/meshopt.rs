//! Decoders of KHR_meshopt_compression and EXT_meshopt_compression, written from the text of the extensions: appendix A
//! (bitstream) for the three modes, appendix B for the filters. EXT is KHR without version 1 of attributes and without
//! the filter COLOR; files that name EXT may use them here all the same, as in meshoptimizer. `None` means that data is
//! cut off or not of the mode.

/// Decodes `count` elements of `size` bytes. The text of an error is meant to follow a place in the file.
pub fn decode(data: &[u8], count: usize, size: usize, mode: &str, filter: &str) -> Result<Vec<u8>, String> {
    // No mode expands a byte further: 2 bits stand for 16 unchanged bytes, in version 1 for 256.
    let most = if data.first() == Some(&VERSION_1) { 1024 } else { 64 };
    if count.checked_mul(size).is_none_or(|total| total / most > data.len()) {
        return Err(format!("{count} elements of {size} bytes, more than {} compressed bytes can hold", data.len()));
    }
    let fits = match (mode, filter) {
        ("ATTRIBUTES", "" | "NONE" | "EXPONENTIAL") => size.is_multiple_of(4) && (4..=256).contains(&size),
        ("ATTRIBUTES", "OCTAHEDRAL" | "COLOR") => size == 4 || size == 8,
        ("ATTRIBUTES", "QUATERNION") => size == 8,
        ("TRIANGLES", "" | "NONE") => (size == 2 || size == 4) && count.is_multiple_of(3),
        ("INDICES", "" | "NONE") => size == 2 || size == 4,
        _ => false,
    };
    if !fits {
        return Err(format!("{count} elements of {size} bytes in mode '{mode}' with filter '{filter}': not valid"));
    }
    let narrow = |indices: Vec<u32>| indices.iter().flat_map(|i| i.to_le_bytes().into_iter().take(size)).collect();
    let decoded = match mode {
        "TRIANGLES" => triangles(data, count).map(narrow),
        "INDICES" => indices(data, count).map(narrow),
        _ => attributes(data, count, size),
    };
    let mut bytes = decoded.ok_or_else(|| format!("data that is cut off or not of mode {mode}"))?;
    match filter {
        "OCTAHEDRAL" => filtered(&mut bytes, size, octahedral),
        "QUATERNION" => filtered(&mut bytes, size, |v, _| quaternion(v)),
        "COLOR" => filtered(&mut bytes, size, color),
        "EXPONENTIAL" => bytes.as_chunks_mut().0.iter_mut().for_each(|v| {
            let bits = i32::from_le_bytes(*v);
            let value = f64::from(bits << 8 >> 8) * f64::from(bits >> 24).exp2();
            *v = (value as f32).to_le_bytes();
        }),
        _ => {}
    }
    Ok(bytes)
}

/// Replaces elements of four signed integers, of a byte or two each; `filter` takes the largest of them, too.
fn filtered(bytes: &mut [u8], size: usize, filter: impl Fn([i32; 4], i32) -> [i32; 4]) {
    let wide = size == 8;
    let largest = if wide { i16::MAX.into() } else { i8::MAX.into() };
    for v in bytes.chunks_exact_mut(size) {
        let stated = [0, 1, 2, 3]
            .map(|i| if wide { i16::from_le_bytes([v[2 * i], v[2 * i + 1]]).into() } else { i32::from(v[i] as i8) });
        let values = filter(stated, largest);
        v.chunks_exact_mut(size / 4)
            .zip(values)
            .for_each(|(v, value)| v.copy_from_slice(&value.to_le_bytes()[..v.len()]));
    }
}

/// Elements in a group.
pub const GROUP: usize = 16;
/// First bytes of the attribute stream, by version.
pub const VERSION_0: u8 = 0xa0;
const VERSION_1: u8 = 0xa1;
/// Bits of the deltas of a group, by the control mode of the byte: 0 is no delta, 8 is whole bytes.
const BITS_VERSION_0: [u8; 4] = [0, 2, 4, 8];
const BITS_CONTROL: [[u8; 4]; 2] = [[0, 1, 2, 4], [1, 2, 4, 8]];

/// Elements of `size` bytes in a block.
pub const fn block_of(size: usize) -> usize {
    let whole = 8192 / size / GROUP * GROUP;
    if whole < 256 { whole } else { 256 }
}

fn attributes(data: &[u8], count: usize, size: usize) -> Option<Vec<u8>> {
    let (&version, rest) = data.split_first()?;
    // The stream ends with the element before the first one and, in version 1, a mode for each four of its bytes.
    let (modes, padded) = match version {
        VERSION_0 => (0, 32),
        VERSION_1 => (size / 4, 24),
        _ => return None,
    };
    let (mut rest, tail) = rest.split_at_checked(rest.len().checked_sub(padded.max(size + modes))?)?;
    let (before, modes) = tail[tail.len() - size - modes..].split_at(size);
    let mut before: Vec<u8> = before.to_vec();
    let modes = if version == VERSION_0 { &[0; 64][..size / 4] } else { modes };
    let mut out = vec![0; count * size];
    for elements in out.chunks_mut(block_of(size) * size) {
        let control = if version == VERSION_0 { &[] } else { rest.split_off(..size / 4)? };
        for byte in 0..size {
            let control = control.get(byte / 4).map(|control| control >> (byte % 4 * 2) & 3);
            read_deltas(&mut rest, control, elements, byte, size)?;
        }
        for ((channel, mode), before) in modes.iter().enumerate().zip(before.as_chunks_mut::<4>().0) {
            for element in elements.chunks_exact_mut(size) {
                let element = &mut element.as_chunks_mut::<4>().0[channel];
                *before = undo_delta(*mode, *element, *before)?;
                *element = *before;
            }
        }
    }
    rest.is_empty().then_some(out)
}

/// Reads the deltas of one byte of all elements of a block. `control` is their storage mode; `None`: as in version 0.
fn read_deltas(rest: &mut &[u8], control: Option<u8>, elements: &mut [u8], byte: usize, size: usize) -> Option<()> {
    let count = elements.len() / size;
    let mut places = elements[byte..].iter_mut().step_by(size);
    let bits = match control {
        None => BITS_VERSION_0,
        Some(mode @ (0 | 1)) => BITS_CONTROL[usize::from(mode)],
        Some(2) => return Some(()),
        Some(_) => {
            places.zip(rest.split_off(..count)?).for_each(|(place, delta)| *place = *delta);
            return Some(());
        }
    };
    let groups = count.div_ceil(GROUP);
    let modes = rest.split_off(..groups.div_ceil(4))?;
    for group in 0..groups {
        let mode = modes[group / 4] >> (group % 4 * 2) & 3;
        let deltas = deltas(rest, bits[usize::from(mode)])?;
        places.by_ref().zip(deltas).for_each(|(place, delta)| *place = delta);
    }
    Some(())
}

/// Reads the deltas of a group: none, 1, 2 or 4 bits each, with a whole byte for those that do not fit, or whole bytes.
fn deltas(rest: &mut &[u8], bits: u8) -> Option<[u8; GROUP]> {
    let mut out = [0; GROUP];
    if bits == 0 {
        return Some(out);
    }
    let bits = usize::from(bits);
    let packed = rest.split_off(..GROUP * bits / 8)?;
    if bits == 8 {
        out.copy_from_slice(packed);
        return Some(out);
    }
    let all = (1u8 << bits) - 1;
    for (i, out) in out.iter_mut().enumerate() {
        let bit = i * bits;
        // The first delta is in the highest bits, except for deltas of one bit.
        let shift = if bits == 1 { bit % 8 } else { 8 - bits - bit % 8 };
        *out = packed[bit / 8] >> shift & all;
        if *out == all {
            *out = *rest.split_off_first()?;
        }
    }
    Some(out)
}

/// Returns four bytes of an element from their delta and the element before; `None` for an unknown mode.
fn undo_delta(mode: u8, delta: [u8; 4], before: [u8; 4]) -> Option<[u8; 4]> {
    Some(match (mode & 15, mode >> 4) {
        (0, 0) => std::array::from_fn(|i| {
            let zigzag = delta[i];
            before[i].wrapping_add(zigzag >> 1 ^ (zigzag & 1).wrapping_neg())
        }),
        (1, 0) => {
            let half = |at: usize| {
                let [zigzag, before] = [delta, before].map(|b| u16::from_le_bytes([b[at], b[at + 1]]));
                before.wrapping_add(zigzag >> 1 ^ (zigzag & 1).wrapping_neg()).to_le_bytes()
            };
            let [[a, b], [c, d]] = [half(0), half(2)];
            [a, b, c, d]
        }
        (2, turn) => (u32::from_le_bytes(delta).rotate_right(turn.into()) ^ u32::from_le_bytes(before)).to_le_bytes(),
        _ => return None,
    })
}

/// A queue; index 0 is the last value pushed.
type Recent<T> = [T; 16];

fn push<T>(queue: &mut Recent<T>, value: T) {
    queue.rotate_right(1);
    queue[0] = value;
}

/// The state of the triangle decoder.
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

    /// Returns the vertex that four bits name, and whether it goes into the queue.
    fn named(&mut self, bits: u8, may_be_explicit: bool) -> Option<(u32, bool)> {
        Some(match bits {
            0 => (self.take_next(), true),
            15 if may_be_explicit => (self.explicit()?, true),
            _ => (self.vertices[usize::from(bits) - 1], false),
        })
    }

    fn triangle(&mut self, code: u8, table: &[u8]) -> Option<[u32; 3]> {
        let high = code >> 4;
        let low = code & 15;
        if high < 15 {
            let [a, b] = self.edges[usize::from(high)];
            let (c, is_new) = match low {
                0 => (self.take_next(), true),
                13 | 14 => {
                    self.last = if low == 13 { self.last.wrapping_sub(1) } else { self.last.wrapping_add(1) };
                    (self.last, true)
                }
                15 => (self.explicit()?, true),
                _ => (self.vertices[usize::from(low)], false),
            };
            push(&mut self.edges, [c, b]);
            push(&mut self.edges, [a, c]);
            if is_new {
                push(&mut self.vertices, c);
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
        [[b, a], [c, b], [a, c]].into_iter().for_each(|edge| push(&mut self.edges, edge));
        for (vertex, is_new) in [(a, true), (b, b_is_new), (c, c_is_new)] {
            if is_new {
                push(&mut self.vertices, vertex);
            }
        }
        Some([a, b, c])
    }
}

fn triangles(data: &[u8], count: usize) -> Option<Vec<u32>> {
    let (codes, rest) = data.strip_prefix(&[0xe1])?.split_at_checked(count / 3)?;
    let (extra, table) = rest.split_last_chunk::<16>()?;
    // Queue entries that were never set are no vertex, as in meshoptimizer: the extension leaves them undefined.
    let mut state = Triangles { extra, next: 0, last: 0, edges: [[u32::MAX; 2]; 16], vertices: [u32::MAX; 16] };
    let mut out = Vec::with_capacity(count);
    for &code in codes {
        out.extend(state.triangle(code, table)?);
    }
    state.extra.is_empty().then_some(out)
}

fn indices(data: &[u8], count: usize) -> Option<Vec<u32>> {
    let (mut rest, _) = data.strip_prefix(&[0xd1])?.split_last_chunk::<4>()?;
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

/// Reads an unsigned number in groups of seven bits, the lowest first.
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

fn octahedral(v: [i32; 4], largest: i32) -> [i32; 4] {
    let [x, y, one, _] = v.map(|c| c as f32);
    let z = one - x.abs() - y.abs();
    let folded = z.min(0.0);
    let x = x - folded.copysign(x);
    let y = y - folded.copysign(y);
    let scale = largest as f32 / (x * x + y * y + z * z).sqrt();
    let [x, y, z] = [x, y, z].map(|c| (c * scale).round() as i32);
    [x, y, z, v[3]]
}

fn quaternion(v: [i32; 4]) -> [i32; 4] {
    let one = (v[3] | 3) as f32;
    let [x, y, z, _] = v.map(|c| c as f32 / one * std::f32::consts::FRAC_1_SQRT_2);
    let w = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
    let largest = (v[3] & 3) as usize;
    let mut out = [0; 4];
    for (i, c) in [w, x, y, z].into_iter().enumerate() {
        out[(largest + i) % 4] = ((c * 32767.0).round() as i16).into();
    }
    out
}

/// Converts luma, chrominance and alpha to red, green, blue and alpha; all have as many bits as `alpha`.
fn color([y, co, cg, alpha]: [i32; 4], largest: i32) -> [i32; 4] {
    // Luma, alpha and colours have no sign.
    let max = 2 * largest + 1;
    let [y, alpha] = [y & max, alpha & max];
    let bits = 32 - alpha.leading_zeros();
    let all = (1 << bits) - 1;
    // The highest bit states the number of bits; the lowest bit is doubled to replace it.
    let opacity = alpha & all >> 1;
    let opacity = opacity << 1 | opacity & 1;
    let scale = max as f32 / all as f32;
    [y + co - cg, y + cg, y - co - cg, opacity].map(|c| ((c as f32 * scale).round() as i32).clamp(0, max))
}
