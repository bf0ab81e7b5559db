//! What programs that track faces send over UDP: VMC (Open Sound Control) and the packets of Live Link Face. Reading
//! takes no memory, and packets may be anything.

use std::str::from_utf8;

/// Addresses of VMC's messages: a weight by name, and that all of a frame are there.
const WEIGHT: &str = "/VMC/Ext/Blend/Val";
const APPLY: &str = "/VMC/Ext/Blend/Apply";
/// Bundles within bundles; VMC has one.
const DEPTH: u32 = 4;
/// The version of Live Link Face's packets that is read, their first byte.
const FACE: u8 = 6;
/// Bytes of a packet that is sent, below what networks split.
const PACKET: usize = 1200;

/// Something in a packet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Heard<'p> {
    /// A weight by name, finite.
    Weight(&'p str, f32),
    /// All weights of a frame have been heard.
    Apply,
}

/// The weights of Live Link Face in their order; angles of head and eyes follow, which move no target.
const SHAPES: [&str; 52] = [
    "eyeBlinkLeft",
    "eyeLookDownLeft",
    "eyeLookInLeft",
    "eyeLookOutLeft",
    "eyeLookUpLeft",
    "eyeSquintLeft",
    "eyeWideLeft",
    "eyeBlinkRight",
    "eyeLookDownRight",
    "eyeLookInRight",
    "eyeLookOutRight",
    "eyeLookUpRight",
    "eyeSquintRight",
    "eyeWideRight",
    "jawForward",
    "jawLeft",
    "jawRight",
    "jawOpen",
    "mouthClose",
    "mouthFunnel",
    "mouthPucker",
    "mouthLeft",
    "mouthRight",
    "mouthSmileLeft",
    "mouthSmileRight",
    "mouthFrownLeft",
    "mouthFrownRight",
    "mouthDimpleLeft",
    "mouthDimpleRight",
    "mouthStretchLeft",
    "mouthStretchRight",
    "mouthRollLower",
    "mouthRollUpper",
    "mouthShrugLower",
    "mouthShrugUpper",
    "mouthPressLeft",
    "mouthPressRight",
    "mouthLowerDownLeft",
    "mouthLowerDownRight",
    "mouthUpperUpLeft",
    "mouthUpperUpRight",
    "browDownLeft",
    "browDownRight",
    "browInnerUp",
    "browOuterUpLeft",
    "browOuterUpRight",
    "cheekPuff",
    "cheekSquintLeft",
    "cheekSquintRight",
    "noseSneerLeft",
    "noseSneerRight",
    "tongueOut",
];

/// Reads a packet; returns whether all of it was understood. What VMC sends beside weights is passed over.
pub fn read<'p>(packet: &'p [u8], heard: &mut dyn FnMut(Heard<'p>)) -> bool {
    match packet.first() {
        Some(b'#' | b'/') => osc(packet, DEPTH, heard).is_some(),
        Some(&FACE) => face(&packet[1..], heard).is_some(),
        _ => false,
    }
}

/// A bundle or message of Open Sound Control.
fn osc<'p>(packet: &'p [u8], depth: u32, heard: &mut dyn FnMut(Heard<'p>)) -> Option<()> {
    let Some(bundle) = packet.strip_prefix(b"#bundle\0") else { return message(packet, heard) };
    let mut rest = bundle.get(8..)?; // after the time
    while !rest.is_empty() {
        let (size, after) = integer(rest)?;
        let (element, after) = after.split_at_checked(size as usize)?;
        osc(element, depth.checked_sub(1)?, heard)?;
        rest = after;
    }
    Some(())
}

fn message<'p>(packet: &'p [u8], heard: &mut dyn FnMut(Heard<'p>)) -> Option<()> {
    let (address, rest) = string(packet)?;
    match address {
        APPLY => heard(Heard::Apply),
        WEIGHT => {
            let (types, rest) = string(rest)?;
            let (name, rest) = string(rest)?;
            let (bits, _) = integer(rest)?;
            let weight = match types {
                ",sf" => f32::from_bits(bits),
                ",si" => bits.cast_signed() as f32,
                ",sd" => f64::from_be_bytes(*rest.first_chunk()?) as f32,
                _ => return None,
            };
            heard(Heard::Weight(name, Some(weight).filter(|weight| weight.is_finite())?));
        }
        _ if address.starts_with('/') => {}
        _ => return None,
    }
    Some(())
}

fn integer(bytes: &[u8]) -> Option<(u32, &[u8])> {
    bytes.split_first_chunk().map(|(first, rest)| (u32::from_be_bytes(*first), rest))
}

/// A string of OSC: to its end, a 0, and on to the next multiple of 4.
fn string(bytes: &[u8]) -> Option<(&str, &[u8])> {
    let length = bytes.iter().position(|byte| *byte == 0)?;
    let rest = bytes.get((length / 4 + 1) * 4..)?;
    Some((from_utf8(&bytes[..length]).ok()?, rest))
}

/// A packet of Live Link Face after its first byte: device, subject, time, weights.
fn face<'p>(packet: &'p [u8], heard: &mut dyn FnMut(Heard<'p>)) -> Option<()> {
    let text = |bytes: &'p [u8]| {
        let (length, rest) = integer(bytes)?;
        rest.get(length as usize..)
    };
    let rest = text(text(packet)?)?.get(16..)?; // frame, its fraction, rate and its denominator
    let (count, rest) = rest.split_first()?;
    let weights = rest.get(..4 * usize::from(*count))?;
    for (name, weight) in SHAPES.iter().zip(weights.as_chunks().0) {
        let weight = f32::from_be_bytes(*weight);
        if weight.is_finite() {
            heard(Heard::Weight(name, weight));
        }
    }
    heard(Heard::Apply);
    Some(())
}

/// Writes the weights of a frame as packets of VMC, the last one with the word to apply them.
pub fn write<'n>(weights: impl Iterator<Item = (&'n str, f32)>) -> Vec<Vec<u8>> {
    let start = || [&b"#bundle\0"[..], &1u64.to_be_bytes()].concat(); // the time 1: at once
    let mut packets = vec![start()];
    let mut add = |message: Vec<u8>| {
        if packets.last().is_some_and(|packet| packet.len() + 4 + message.len() > PACKET) {
            packets.push(start());
        }
        if let Some(packet) = packets.last_mut() {
            packet.extend((message.len() as u32).to_be_bytes());
            packet.extend(message);
        }
    };
    let text = |text: &str| {
        let mut bytes = text.as_bytes().to_vec();
        bytes.resize((text.len() / 4 + 1) * 4, 0);
        bytes
    };
    for (name, weight) in weights {
        add([text(WEIGHT), text(",sf"), text(name), weight.to_be_bytes().to_vec()].concat());
    }
    add([text(APPLY), text(",")].concat());
    packets
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltamorph_head::Rng;

    /// What is in a packet, and whether all of it was understood.
    fn all(packet: &[u8]) -> (Vec<Heard<'_>>, bool) {
        let mut found = vec![];
        let understood = read(packet, &mut |heard| found.push(heard));
        (found, understood)
    }

    /// A packet of Live Link Face whose k-th weight is k / 100.
    fn of_face() -> Vec<u8> {
        let mut packet = vec![FACE];
        for text in ["a device", "größe"] {
            packet.extend((text.len() as u32).to_be_bytes());
            packet.extend(text.as_bytes());
        }
        packet.extend([7u32, 0, 60, 1].iter().flat_map(|number| number.to_be_bytes()));
        packet.push(61);
        packet.extend((0..61u8).flat_map(|k| (f32::from(k) / 100.0).to_be_bytes()));
        packet
    }

    #[test]
    fn packets_are_read_as_they_were_written() {
        let names: Vec<String> = (0..120).map(|i| format!("größe{i}")).collect();
        let weights = || names.iter().map(|name| (&**name, name.len() as f32 / 16.0));
        let packets = write(weights());
        assert!(packets.len() > 1 && packets.iter().all(|packet| packet.len() <= PACKET));
        let read: Vec<_> = packets.iter().map(|packet| all(packet)).collect();
        assert!(read.iter().all(|(_, understood)| *understood));
        let found: Vec<_> = read.into_iter().flat_map(|(found, _)| found).collect();
        let sent: Vec<_> = weights().map(|(name, weight)| Heard::Weight(name, weight)).chain([Heard::Apply]).collect();
        assert_eq!(found, sent);

        let face = of_face();
        let (found, understood) = all(&face);
        assert!(understood && found.len() == 53 && found[52] == Heard::Apply);
        assert_eq!((found[17], found[51]), (Heard::Weight("jawOpen", 0.17), Heard::Weight("tongueOut", 0.51)));
    }

    #[test]
    fn other_types_and_messages_are_read_or_passed_over() {
        let message = |parts: &[&[u8]]| parts.concat();
        let weight = |types: &[u8], bits: &[u8]| message(&[b"/VMC/Ext/Blend/Val\0\0", types, b"Joy\0", bits]);
        assert_eq!(all(&weight(b",sd\0", &0.25f64.to_be_bytes())), (vec![Heard::Weight("Joy", 0.25)], true));
        assert_eq!(all(&weight(b",si\0", &1i32.to_be_bytes())), (vec![Heard::Weight("Joy", 1.0)], true));
        assert_eq!(all(&weight(b",sf\0", &f32::NAN.to_be_bytes())), (vec![], false));
        assert_eq!(all(&weight(b",ss\0", b"1\0\0\0")), (vec![], false));
        assert_eq!(all(b"/VMC/Ext/T\0\0,f\0\0\0\0\0\0"), (vec![], true));
        assert_eq!(all(b"#bundle\0\0\0\0\0\0\0\0\x01"), (vec![], true));
    }

    #[test]
    fn packets_may_be_anything() {
        let mut deep = b"/VMC/Ext/Blend/Apply\0\0\0\0,\0\0\0".to_vec();
        for level in 0..3000 {
            let size = (deep.len() as u32).to_be_bytes();
            deep = [&b"#bundle\0\0\0\0\0\0\0\0\x01"[..], &size, &deep].concat();
            assert_eq!(all(&deep).1, level < DEPTH, "{level}");
        }
        let good = [write([("jawOpen", 0.5), ("mouthSmileLeft", 1.0)].into_iter()).remove(0), of_face()];
        let (mut rng, mut weights, mut understood) = (Rng::new(1, 0), 0u64, 0u64);
        let mut packet = vec![];
        for i in 0..1_000_000 {
            packet.clear();
            match i % 4 {
                // Noise; noise behind a good beginning; a good packet that is cut; one with bytes that are wrong.
                0 | 1 => {
                    packet.extend_from_slice(&good[rng.below(2)][..if i % 4 == 0 { 0 } else { 1 + rng.below(40) }]);
                    (0..rng.below(64)).for_each(|_| packet.push(rng.below(256) as u8));
                }
                2 => {
                    let whole = &good[rng.below(2)];
                    packet.extend_from_slice(&whole[..rng.below(whole.len())]);
                }
                _ => {
                    packet.extend_from_slice(&good[rng.below(2)]);
                    for _ in 0..1 + rng.below(3) {
                        let at = rng.below(packet.len());
                        packet[at] = rng.below(256) as u8;
                    }
                }
            }
            understood += u64::from(read(&packet, &mut |heard| {
                if let Heard::Weight(_, weight) = heard {
                    assert!(weight.is_finite());
                    weights += 1;
                }
            }));
        }
        println!("{understood} of 1,000,000 were understood, with {weights} weights");
        assert!(understood > 1000 && understood < 300_000);
    }
}
