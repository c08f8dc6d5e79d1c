//! GigE Vision Control Protocol (GVCP): reads the register that states whether a program controls a camera.

use std::io;
use std::net::{Ipv4Addr, UdpSocket};
use std::time::{Duration, Instant};

/// Port of the protocol.
const PORT: u16 = 3956;
/// Register with the control privilege.
const PRIVILEGE: u32 = 0x0A00;
/// Bits of exclusive access and of control.
const CONTROLLED: u32 = 0b11;
/// Time for an answer.
const ANSWER: Duration = Duration::from_millis(300);
/// Number of requests, since datagrams may be lost.
const REQUESTS: u16 = 3;

/// State of a camera on the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Control {
    /// No program controls the camera.
    Free,
    /// A program controls the camera.
    Taken,
    /// The camera does not answer at this address.
    Silent,
}

/// Asks a camera who controls it. The camera is not opened.
pub fn control(address: Ipv4Addr) -> Control {
    (1..=REQUESTS).find_map(|id| ask(address, id).ok().flatten()).unwrap_or(Control::Silent)
}

fn ask(address: Ipv4Addr, id: u16) -> io::Result<Option<Control>> {
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
    socket.connect((address, PORT))?;
    socket.send(&request(id))?;
    let begun = Instant::now();
    let mut reply = [0; 64];
    while let Some(left) = ANSWER.checked_sub(begun.elapsed()).filter(|left| !left.is_zero()) {
        socket.set_read_timeout(Some(left))?;
        let length = socket.recv(&mut reply)?;
        if let Some(privilege) = register(&reply[..length], id) {
            return Ok(Some(if privilege & CONTROLLED == 0 { Control::Free } else { Control::Taken }));
        }
    }
    Ok(None)
}

/// Request to read the privilege register.
fn request(id: u16) -> [u8; 12] {
    let mut request = [0x42, 0x01, 0x00, 0x80, 0x00, 0x04, 0, 0, 0, 0, 0, 0];
    request[6..8].copy_from_slice(&id.to_be_bytes());
    request[8..].copy_from_slice(&PRIVILEGE.to_be_bytes());
    request
}

/// Value of a register in the answer to the request with this number; `None` for any other datagram.
pub fn register(reply: &[u8], id: u16) -> Option<u32> {
    let [status @ .., _, _, _, _] = reply.first_chunk::<12>()?;
    let word = |at: usize| Some(u16::from_be_bytes([*status.get(at)?, *status.get(at + 1)?]));
    // Status, kind of answer, length, number.
    let answers = (word(0)?, word(2)?, word(4)?, word(6)?) == (0, 0x0081, 4, id);
    answers.then(|| u32::from_be_bytes([reply[8], reply[9], reply[10], reply[11]]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn answers_are_read_and_other_datagrams_are_not() {
        let answer = [0, 0, 0, 0x81, 0, 4, 0, 7, 0, 0, 0, 2];
        assert_eq!(register(&answer, 7), Some(2));
        assert_eq!(register(&answer, 8), None, "an answer to another request");
        assert_eq!(register(&answer[..11], 7), None);
        let refused = [0x80, 0x06, 0, 0x81, 0, 4, 0, 7, 0, 0, 0, 0];
        assert_eq!(register(&refused, 7), None);
        assert_eq!(request(7), [0x42, 1, 0, 0x80, 0, 4, 0, 7, 0, 0, 0x0A, 0]);
    }

    #[test]
    fn a_host_without_a_camera_is_silent() {
        let begun = Instant::now();
        assert_eq!(control(Ipv4Addr::new(127, 77, 66, 55)), Control::Silent);
        assert!(begun.elapsed() < Duration::from_secs(10));
    }

    proptest! {
        #[test]
        fn no_datagram_is_too_wild(reply: Vec<u8>, id: u16) {
            let _ = register(&reply, id);
        }
    }
}
