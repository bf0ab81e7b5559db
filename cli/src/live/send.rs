//! A clip over UDP, at its rate: for those who have no phone at hand.

use super::packets;
use crate::output::{Failure, Output};
use crate::table::thousands;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

/// Sends frames of weights as packets of VMC.
pub fn run(
    to: SocketAddr,
    names: &[&str],
    frames: impl Iterator<Item = Vec<f32>>,
    fps: f32,
    out: &Output,
) -> Result<(), Failure> {
    let refused = |e: std::io::Error| Failure::Failed(format!("--send {to}: {e}; give another address"));
    let any = if to.is_ipv4() { Ipv4Addr::UNSPECIFIED.into() } else { Ipv6Addr::UNSPECIFIED.into() };
    let socket = UdpSocket::bind(SocketAddr::new(any, 0)).map_err(refused)?;
    let (begin, mut sent, mut count) = (Instant::now(), 0, 0);
    for (frame, weights) in (0u32..).zip(frames) {
        let due = begin + Duration::from_secs_f64(f64::from(frame) / f64::from(fps));
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        for packet in packets::write(names.iter().copied().zip(weights)) {
            socket.send_to(&packet, to).map_err(refused)?;
            sent += 1;
        }
        count += 1;
    }
    let (count, weights, sent) = (thousands(count), names.len(), thousands(sent));
    out.say(format_args!("{count} frames of {weights} weights sent to {to} at {fps} a second, in {sent} packets"));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::packets::{Heard, read};
    use super::*;

    #[test]
    fn frames_arrive_at_their_rate() {
        let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
        let to = socket.local_addr().expect("an address");
        let begin = Instant::now();
        let frames = (0..12u8).map(|i| vec![f32::from(i) / 12.0, 1.0]);
        run(to, &["jawOpen", "cheekPuff"], frames, 120.0, &Output::new(true, None)).expect("sent");
        assert!(begin.elapsed() >= Duration::from_secs_f64(11.0 / 120.0));
        socket.set_nonblocking(true).expect("a socket that does not wait");
        let (mut buffer, mut heard) = ([0; 1500], vec![]);
        while let Ok(length) = socket.recv(&mut buffer) {
            let understood = read(&buffer[..length], &mut |what| match what {
                Heard::Weight(name, weight) => heard.push((name.to_owned(), weight)),
                Heard::Apply => heard.push((String::new(), 0.0)),
            });
            assert!(understood);
        }
        assert_eq!(heard.len(), 36);
        assert_eq!(heard[33..], [("jawOpen".into(), 11.0 / 12.0), ("cheekPuff".into(), 1.0), (String::new(), 0.0)]);
    }
}
