//! Encoders of EXT_meshopt_compression, from the text of the extension: the bitstream that `meshopt.rs` decodes,
//! version 0 of attributes and version 1 of triangles.

use super::super::meshopt::{GROUP, Recent, VERSION_0, block_of};

/// Encodes elements of `size` bytes, a multiple of 4 up to 256.
pub fn attributes(bytes: &[u8], size: usize) -> Vec<u8> {
    let first = &bytes[..size];
    let (mut out, mut before) = (vec![VERSION_0], first.to_vec());
    for elements in bytes.chunks(block_of(size) * size) {
        for (byte, before) in before.iter_mut().enumerate() {
            let deltas = elements[byte..].iter().step_by(size).map(|&value| {
                let delta = value.wrapping_sub(std::mem::replace(before, value)) as i8;
                (delta << 1 ^ delta >> 7) as u8
            });
            groups(&deltas.collect::<Vec<u8>>(), &mut out);
        }
    }
    out.resize(out.len() + 32usize.saturating_sub(size), 0);
    out.extend(first);
    out
}

/// Appends the modes of all groups of deltas, then each group in the mode that takes least.
fn groups(deltas: &[u8], out: &mut Vec<u8>) {
    let modes = out.len();
    out.resize(modes + deltas.len().div_ceil(GROUP).div_ceil(4), 0);
    for (i, group) in deltas.chunks(GROUP).enumerate() {
        let mut padded = [0; GROUP];
        padded[..group.len()].copy_from_slice(group);
        let longer = |all: u8| padded.iter().filter(|delta| **delta >= all).count();
        let two = if padded == [0; GROUP] { 0 } else { 4 + longer(3) };
        let (mode, bits) = match (two, 8 + longer(15)) {
            (0, _) => continue,
            (two, four) if two <= four.min(16) => (1, 2),
            (_, four) if four < 16 => (2, 4),
            _ => (3, 8),
        };
        out[modes + i / 4] |= mode << (i % 4 * 2);
        if bits == 8 {
            out.extend(padded);
            continue;
        }
        let all = (1 << bits) - 1;
        // The first delta is in the highest bits.
        let packed = padded.chunks(8 / bits).map(|some| some.iter().fold(0, |byte, d| byte << bits | d.min(&all)));
        out.extend(packed);
        out.extend(padded.iter().filter(|delta| **delta >= all));
    }
}

/// Two vertices that complete a triangle are often named by one byte: those of this table are.
const TABLE: [u8; 16] =
    [0x00, 0x76, 0x87, 0x56, 0x67, 0x78, 0xa9, 0x86, 0x65, 0x89, 0x68, 0x98, 0x01, 0x69, 0x00, 0x00];

/// Encodes triangles; their corners may be turned.
pub fn triangles(indices: &[u32]) -> Vec<u8> {
    let (mut edges, mut vertices) = (Recent([[u32::MAX; 2]; 16], 0), Recent([u32::MAX; 16], 0));
    let (mut next, mut last) = (0, 0);
    let (mut codes, mut extra) = (vec![0xe1], vec![]);
    let explicit = |vertex: u32, last: &mut u32, extra: &mut Vec<u8>| {
        zigzag(vertex.wrapping_sub(*last), extra);
        *last = vertex;
    };
    let take = |vertex: u32, next: &mut u32| {
        let is_next = vertex == *next;
        *next += u32::from(is_next);
        is_next
    };
    for &triangle in indices.as_chunks::<3>().0 {
        let turned = |by: usize| [0, 1, 2].map(|i| triangle[(i + by) % 3]);
        let edge =
            (0..15).find_map(|back| (0..3).find(|by| edges.get(back)[..] == turned(*by)[..2]).map(|by| (back, by)));
        if let Some((back, by)) = edge {
            let [a, b, c] = turned(by);
            let known = (1..13).find(|back| vertices.get(*back) == c);
            let low = match known {
                Some(back) => back as u8,
                None if take(c, &mut next) => 0,
                None if c.wrapping_add(1) == last => 13,
                None if c == last.wrapping_add(1) => 14,
                None => 15,
            };
            codes.push((back as u8) << 4 | low);
            match low {
                13 | 14 => last = c,
                15 => explicit(c, &mut last, &mut extra),
                _ => {}
            }
            if known.is_none() {
                vertices.push(c);
            }
            edges.push([c, b]);
            edges.push([a, c]);
            continue;
        }
        // A new vertex comes first.
        let [a, b, c] = turned(triangle.iter().position(|vertex| *vertex == next).unwrap_or(0));
        let known = [b, c].map(|vertex| (0..14).find(|back| vertices.get(*back) == vertex));
        let is_new = take(a, &mut next);
        let named = [(b, known[0]), (c, known[1])].map(|(vertex, known)| match known {
            Some(back) => back as u8 + 1,
            None if take(vertex, &mut next) => 0,
            None => 15,
        });
        let names = named[0] << 4 | named[1];
        let listed = TABLE[..14].iter().position(|entry| *entry == names).filter(|_| is_new);
        codes.push(0xf0 | listed.map_or(if is_new { 14 } else { 15 }, |at| at as u8));
        if listed.is_none() {
            extra.push(names);
        }
        for (vertex, is_explicit) in [(a, !is_new), (b, named[0] == 15), (c, named[1] == 15)] {
            if is_explicit {
                explicit(vertex, &mut last, &mut extra);
            }
        }
        for (vertex, is_pushed) in [(a, true), (b, known[0].is_none()), (c, known[1].is_none())] {
            if is_pushed {
                vertices.push(vertex);
            }
        }
        [[b, a], [c, b], [a, c]].into_iter().for_each(|edge| edges.push(edge));
    }
    [codes, extra, TABLE.to_vec()].concat()
}

/// Encodes a sequence of indices.
pub fn indices(indices: &[u32]) -> Vec<u8> {
    let (mut out, mut last) = (vec![0xd1], 0u32);
    for &index in indices {
        // The lowest bit names one of two previous indices: always the first.
        let delta = index.wrapping_sub(last);
        leb128((delta << 1 ^ (delta as i32 >> 31) as u32) << 1, &mut out);
        last = index;
    }
    out.resize(out.len() + 4, 0);
    out
}

fn zigzag(delta: u32, out: &mut Vec<u8>) {
    leb128(delta << 1 ^ (delta as i32 >> 31) as u32, out);
}

/// Appends a number in groups of seven bits, the lowest first.
fn leb128(mut value: u32, out: &mut Vec<u8>) {
    while value >= 128 {
        out.push(value as u8 | 128);
        value >>= 7;
    }
    out.push(value as u8);
}
