//! The weights that arrive, by what the mesh has.

use super::packets::{self, Heard};
use crate::output::Failure;
use deltamorph::WeightClip;
use std::collections::HashMap;
use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

/// Names that are kept, of any that are heard, and bytes of a name.
const NAMES: usize = 512;
const NAME: usize = 256;
/// Packets that are read for a frame: more are left to the next one, or to the system to drop.
const PACKETS: usize = 4096;
/// The largest weight that is taken, either sign; trackers send 0 to 1.
const MOST: f32 = 4.0;
/// Time over which frames are counted.
const COUNTED: Duration = Duration::from_secs(1);

/// A socket, and the weights that were heard.
pub struct Live {
    socket: UdpSocket,
    pub address: SocketAddr,
    buffer: Vec<u8>,
    names: HashMap<String, usize>,
    /// Weight of each name, heard and not yet applied.
    weights: Vec<f32>,
    /// For each name the sliders that it moves, with factors; anew where names are new.
    sliders: Vec<Vec<(usize, f32)>>,
    bound: usize,
    pub counts: Counts,
    /// Frames since `since`, and in the time before.
    since: (Instant, u64),
    /// Frames in a second.
    pub rate: f64,
    pub last: Option<Instant>,
}

/// What was heard.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Counts {
    pub packets: u64,
    /// Packets of them that were not understood, or not to their end.
    pub bad: u64,
    /// Frames that were applied.
    pub frames: u64,
    /// Weights of names that move nothing here.
    pub unknown: u64,
}

impl Live {
    pub fn new(address: SocketAddr) -> Result<Self, Failure> {
        let refused = |what: &str, e: std::io::Error| {
            Failure::Failed(format!("--listen {address}: {what}: {e}; give another address or port"))
        };
        let socket = UdpSocket::bind(address).map_err(|e| refused("nothing can be received there", e))?;
        socket.set_nonblocking(true).map_err(|e| refused("the socket waits", e))?;
        let address = socket.local_addr().map_err(|e| refused("the socket has no address", e))?;
        Ok(Self {
            socket,
            address,
            buffer: vec![0; 1 << 16],
            names: HashMap::new(),
            weights: vec![],
            sliders: vec![],
            bound: 0,
            counts: Counts::default(),
            since: (Instant::now(), 0),
            rate: 0.0,
            last: None,
        })
    }

    /// Forgets which sliders names move: for another mesh.
    pub fn forget(&mut self) {
        self.bound = 0;
    }

    /// Takes what has arrived. `controls`: names of the sliders, whose weights are changed where a frame was applied;
    /// returns whether one was.
    pub fn poll(&mut self, controls: &[String], values: &mut [f32]) -> bool {
        let before = self.counts.frames;
        for _ in 0..PACKETS {
            match self.socket.recv(&mut self.buffer) {
                Ok(length) => {
                    let buffer = std::mem::take(&mut self.buffer);
                    self.take(&buffer[..length], controls, values);
                    self.buffer = buffer;
                }
                Err(e) if e.kind() == ErrorKind::WouldBlock => break,
                // As a host that is not there: of no packet here.
                Err(_) => {}
            }
        }
        let (since, count) = &mut self.since;
        *count += self.counts.frames - before;
        if since.elapsed() >= COUNTED {
            self.rate = *count as f64 / since.elapsed().as_secs_f64();
            self.since = (Instant::now(), 0);
        }
        let heard = self.counts.frames > before;
        self.last = if heard { Some(Instant::now()) } else { self.last };
        heard
    }

    /// Takes a packet.
    fn take(&mut self, packet: &[u8], controls: &[String], values: &mut [f32]) {
        let (mut frames, mut unknown) = (0, 0);
        let Self { names, weights, sliders, bound, .. } = self;
        let understood = packets::read(packet, &mut |heard| match heard {
            Heard::Weight(name, weight) => match names.get(name) {
                Some(&at) => {
                    weights[at] = weight;
                    unknown += u64::from(at < *bound && sliders[at].is_empty());
                }
                None if names.len() < NAMES && name.len() <= NAME => {
                    names.insert(name.to_owned(), weights.len());
                    weights.push(weight);
                }
                None => unknown += 1,
            },
            Heard::Apply => {
                if *bound < weights.len() {
                    *sliders = bind(names, weights.len(), controls);
                    unknown += sliders[*bound..].iter().filter(|sliders| sliders.is_empty()).count() as u64;
                    *bound = weights.len();
                }
                apply(weights, sliders, values);
                frames += 1;
            }
        });
        self.counts.packets += 1;
        self.counts.bad += u64::from(!understood);
        self.counts.frames += frames;
        self.counts.unknown += unknown;
    }

    /// Whether something was heard in the last two seconds.
    pub fn hears(&self) -> bool {
        self.last.is_some_and(|last| last.elapsed() < 2 * COUNTED)
    }

    /// Names that are heard: how many move a slider, and those that move none.
    pub fn names(&self) -> (usize, Vec<&str>) {
        let moves = |at: usize| self.sliders.get(at).is_some_and(|sliders| !sliders.is_empty());
        let mut lost: Vec<&str> =
            self.names.iter().filter(|(_, at)| !moves(**at)).map(|(name, _)| name.as_str()).collect();
        lost.sort_unstable();
        (self.names.len() - lost.len(), lost)
    }
}

/// The sliders that each name moves, with factors, in any spelling of the name.
fn bind(names: &HashMap<String, usize>, count: usize, controls: &[String]) -> Vec<Vec<(usize, f32)>> {
    let controls: Vec<&str> = controls.iter().map(String::as_str).collect();
    let mut sliders = vec![vec![]; count];
    for (name, at) in names {
        let clip = WeightClip { names: vec![name.clone()], ..WeightClip::default() };
        let (found, _) = clip.renamed(&controls);
        let place = |name: &String| Some((controls.iter().position(|control| control == name)?, 1.0));
        sliders[*at] = found.names.iter().filter_map(place).collect();
    }
    sliders
}

/// Sets the sliders that names move, to [`MOST`] at most: strangers may send any number.
fn apply(weights: &[f32], sliders: &[Vec<(usize, f32)>], values: &mut [f32]) {
    let moved = || sliders.iter().flatten().map(|(slider, _)| *slider).filter(|slider| *slider < values.len());
    let mut sums: HashMap<usize, f32> = moved().map(|slider| (slider, 0.0)).collect();
    for (weight, sliders) in weights.iter().zip(sliders) {
        for (slider, factor) in sliders {
            sums.entry(*slider).and_modify(|sum| *sum += weight * factor);
        }
    }
    for (slider, sum) in sums {
        // Sums of what is finite may not be.
        values[slider] = if sum.is_nan() { 0.0 } else { sum.clamp(-MOST, MOST) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltamorph_head::Rng;

    /// A socket, and sliders.
    fn live() -> (Live, [String; 4]) {
        let names = ["jawOpen", "mouthSmileLeft", "browInnerUp_L", "browInnerUp_R"];
        (Live::new("127.0.0.1:0".parse().expect("an address")).expect("a socket"), names.map(str::to_owned))
    }

    #[test]
    fn names_find_their_sliders_and_unknown_ones_are_counted() {
        let ((mut live, controls), mut values) = (live(), [0.25, 0.0, 0.0, 0.0]);
        for packet in packets::write([("browInnerUp", 0.5), ("MouthSmileLeft", 3.0), ("Fun", 1.0)].into_iter()) {
            live.take(&packet, &controls, &mut values);
        }
        // What nobody sends stays as it is.
        assert_eq!(values, [0.25, 3.0, 0.5, 0.5]);
        let counts = Counts { packets: 1, bad: 0, frames: 1, unknown: 1 };
        assert_eq!((live.counts, live.names()), (counts, (2, vec!["Fun"])));
        live.take(b"\0", &controls, &mut values);
        assert_eq!(live.counts, Counts { packets: 2, bad: 1, ..counts });
    }

    #[test]
    fn lost_doubled_and_late_packets_do_no_harm() {
        let ((mut live, controls), mut values, mut rng) = (live(), [0.0; 4], Rng::new(3, 0));
        let to = live.address;
        let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
        let frames: Vec<Vec<u8>> =
            (0..200u8).flat_map(|i| packets::write([("jawOpen", f32::from(i) / 200.0)].into_iter())).collect();
        for packet in &frames {
            for _ in 0..rng.below(3) {
                socket.send_to(packet, to).expect("sent");
            }
            live.poll(&controls, &mut values);
        }
        socket.send_to(&frames[100], to).expect("sent");
        let end = Instant::now() + Duration::from_secs(5);
        while values[0] != 0.5 && Instant::now() < end {
            live.poll(&controls, &mut values);
        }
        assert_eq!((values[0], live.counts.bad), (0.5, 0));
        assert!(live.counts.frames > 50);
    }

    #[test]
    fn strangers_take_no_memory_and_weights_stay_in_bounds() {
        let ((mut live, controls), mut values, mut rng) = (live(), [0.0; 4], Rng::new(5, 0));
        for i in 0..4000 {
            let (name, weight) = (format!("name {i}"), f32::from_bits(rng.next_u64() as u32));
            for packet in packets::write([(&*name, 1.0), ("jawOpen", weight), ("JawOpen", weight)].into_iter()) {
                live.take(&packet, &controls, &mut values);
            }
            assert!(values.iter().all(|value| (-MOST..=MOST).contains(value)), "{values:?}");
        }
        assert_eq!((live.names.len(), live.weights.len(), live.sliders.len()), (NAMES, NAMES, NAMES));
        assert!(live.counts.unknown > 3000);
    }
}
