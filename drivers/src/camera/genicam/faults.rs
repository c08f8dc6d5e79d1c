//! Faults of GenICam cameras in words, each with a remedy.

use super::node::{Cause, Failure, Packets, Status};
use crate::{Class, DeviceError};

/// Share of missing packets above which the network is at fault, not chance.
const LOSSY: f64 = 0.001;

/// Error of a camera that cannot be opened.
pub fn opening(device: &str, failure: &Failure) -> DeviceError {
    let error = DeviceError::new(device, "open", "a camera", &*failure.text).class(Class::Setup);
    match failure.cause {
        Cause::Library => error.remedy("install aravis 0.8 (Debian: apt install libaravis-0.8-0)"),
        Cause::Missing => error.remedy(
            "`nacre devices` lists the cameras that answer; check power and cable, and that the camera's address belongs \
             to the network of this computer",
        ),
        Cause::Held => error.remedy(
            "end the program that controls the camera; after a crash the camera is free within some seconds",
        ),
        Cause::Gone => error.remedy("check the camera's power and cable, then try again"),
        Cause::Unsupported | Cause::Other => error.remedy("choose another camera, or report this message"),
    }
}

/// Error of a failed command.
pub fn command(id: &str, command: &str, expected: &str, failure: &Failure) -> DeviceError {
    let error = DeviceError::new(id, command, expected, &*failure.text);
    match failure.cause {
        Cause::Missing | Cause::Gone => error.remedy("check the camera's power and cable").class(Class::Lost),
        Cause::Held => error.remedy("end the other program that controls the camera").class(Class::Lost),
        Cause::Library | Cause::Unsupported => {
            error.remedy("the camera cannot do this: choose another value or camera").class(Class::Setup)
        }
        Cause::Other => error.remedy("restart the camera if this comes back").class(Class::Retry),
    }
}

/// Defect of an incomplete frame; `None` for a complete one.
pub fn defect(status: Status) -> Option<&'static str> {
    match status {
        Status::Complete => None,
        Status::MissingPackets => Some("an incomplete frame: packets are missing"),
        Status::Timeout => Some("an incomplete frame: its end did not arrive in time"),
        Status::WrongPacket => Some("an incomplete frame: a packet has a wrong number"),
        Status::WrongSize => Some("a frame larger than announced"),
        Status::Aborted => Some("an incomplete frame: the stream ended"),
        Status::NoPicture => Some("a payload that is not a picture"),
    }
}

/// Error of an incomplete frame. `packet_size` is `None` for USB cameras.
pub fn incomplete(id: &str, defect: &str, packets: Packets, packet_size: Option<u32>) -> DeviceError {
    let Packets { received, missing, .. } = packets;
    let share = missing as f64 / (received + missing).max(1) as f64;
    let got = match missing {
        0 => defect.to_owned(),
        _ => format!("{defect} ({missing} of {} since the stream began, {:.2} %)", received + missing, 100.0 * share),
    };
    let remedy = match packet_size {
        None => "connect the camera to a USB 3 socket of its own, with a shorter cable".to_owned(),
        Some(size) if share > LOSSY && size <= 1500 => format!(
            "packets of {size} bytes are lost: enable jumbo frames (MTU 9000) on the network interface, or set a lower \
             fps; `nacre doctor` examines the network"
        ),
        Some(_) => "connect the camera directly to a network socket of its own, or set a lower fps; `nacre doctor` \
                    examines the network"
            .to_owned(),
    };
    DeviceError::new(id, "take a frame", "a complete frame", got).remedy(remedy).class(Class::Retry)
}

/// Error of a camera whose next frame is overdue. `answers` is whether it still answers commands.
pub fn silent(id: &str, waited_s: f64, answers: bool, packets: Packets, packet_size: Option<u32>) -> DeviceError {
    let none = format!("none within {waited_s:.1} s");
    let error = |got: String| DeviceError::new(id, "take a frame", "a frame", got);
    match (answers, packet_size) {
        (false, _) => error(format!("{none}, and the camera does not answer"))
            .remedy("check the camera's power and cable, then resume the session")
            .class(Class::Lost),
        (true, Some(size)) if packets.received == 0 => {
            error(format!("{none}: the camera answers, but no packet of its pictures arrives"))
                .remedy(format!(
                    "let UDP from the camera pass the firewall, or give a `packet_size` below {size}: a network device \
                     may drop larger packets"
                ))
                .class(Class::Retry)
        }
        (true, _) => error(format!("{none}, although the camera answers"))
            .remedy("give a longer frame period (lower fps), or restart the camera")
            .class(Class::Retry),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lost_packets_are_counted_and_jumbo_frames_advised() {
        let packets = Packets { received: 990, missing: 10, underruns: 0 };
        let error = incomplete("cam", defect(Status::MissingPackets).unwrap(), packets, Some(1400));
        assert!(error.got.contains("packets are missing (10 of 1000") && error.remedy.contains("MTU 9000"), "{error}");
        assert_eq!(error.class, Class::Retry);
        let usb = incomplete("cam", defect(Status::Timeout).unwrap(), Packets::default(), None);
        assert!(usb.remedy.contains("USB 3") && usb.got.contains("in time"), "{usb}");
        let large = incomplete("cam", "x", packets, Some(9000));
        assert!(!large.remedy.contains("jumbo"), "{large}");
    }

    #[test]
    fn a_silent_camera_is_lost_only_if_it_does_not_answer() {
        let none = Packets::default();
        assert_eq!(silent("cam", 1.0, false, none, Some(1400)).class, Class::Lost);
        let blocked = silent("cam", 1.0, true, none, Some(9000));
        assert!(blocked.remedy.contains("firewall") && blocked.class == Class::Retry, "{blocked}");
        let some = Packets { received: 9, ..none };
        assert!(!silent("cam", 1.0, true, some, Some(9000)).remedy.contains("firewall"));
        assert_eq!(silent("cam", 1.0, true, none, None).class, Class::Retry);
    }

    #[test]
    fn every_cause_has_its_class() {
        for (cause, class) in [(Cause::Gone, Class::Lost), (Cause::Held, Class::Lost), (Cause::Other, Class::Retry)] {
            assert_eq!(command("cam", "x", "y", &Failure::new(cause, "z")).class, class);
            assert_eq!(opening("cam", &Failure::new(cause, "z")).class, Class::Setup);
        }
        assert!(opening("cam", &Failure::new(Cause::Held, "z")).remedy.contains("program"));
        assert_eq!(defect(Status::Complete), None);
    }
}
