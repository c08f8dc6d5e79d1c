//! `nacre sim attach`: emulated devices that act on the simulated bench and speak the real wire protocols.

use crate::console::Console;
use nacre_base::Error;
use nacre_base::progress::Progress;
use nacre_capture::Failure;
use nacre_drivers::DeviceResult;
use nacre_sim::Port;
use nacre_sim::emulators::{
    Blink1Emulator, BulkEmulator, ByteFault, ByteFaultKind, InterlockEmulator, Pty, RelayEmulator, Served, elliptec,
    grbl,
};
use nacre_sim::socket::RemoteBench;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Arguments of `nacre sim attach`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre sim bench --socket /tmp/bench &
  nacre sim attach --socket /tmp/bench --device elliptec=/tmp/stage --device relay=/tmp/relay
  nacre sim attach --socket /tmp/bench --device elliptec=/tmp/stage --fault elliptec:half_answer:20:1

Configuration (nacre.toml) for these devices:
  [bench]
  sim = true
  socket = \"/tmp/bench\"
  stage = { driver = { kind = \"elliptec\", port = \"/tmp/stage\" } }
  flash = { driver = { kind = \"relay\", path = \"unix:/tmp/relay\" } }")]
pub struct Args {
    /// Socket of the simulated bench.
    #[arg(long)]
    socket: PathBuf,
    #[command(flatten)]
    emulated: Emulated,
}

/// Devices to emulate, and their faults.
#[derive(clap::Args, Default)]
pub struct Emulated {
    /// Device kind (elliptec, grbl, relay, blink1, bulk or interlock) and the path of the port or socket to create.
    #[arg(long = "device", value_name = "KIND=PATH", value_parser = device)]
    devices: Vec<(Kind, PathBuf)>,
    /// Fault to inject after AFTER successful commands, TIMES times: no_answer, half_answer, dropped, garbage, resend,
    /// reset, slow, wrong_status or stuck_busy.
    #[arg(long = "fault", value_name = "KIND:FAULT[:AFTER[:TIMES]]", value_parser = fault)]
    faults: Vec<(Kind, ByteFault)>,
    /// Encoder pulses per turn of the emulated Elliptec stage (360 to 16777216).
    #[arg(long, default_value_t = 143_360, value_parser = clap::value_parser!(u32).range(360..=16_777_216))]
    pulses_per_turn: u32,
}

/// Kinds of devices that can be emulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Elliptec,
    Grbl,
    Relay,
    Blink1,
    Bulk,
    Interlock,
}

/// Running emulated devices; dropping the value stops them.
#[derive(Default)]
pub struct Attached {
    #[allow(dead_code, reason = "held until it is dropped")]
    ports: Vec<Pty>,
    #[allow(dead_code, reason = "held until it is dropped")]
    sockets: Vec<Served>,
}

fn kind(text: &str) -> Result<Kind, String> {
    Ok(match text {
        "elliptec" => Kind::Elliptec,
        "grbl" => Kind::Grbl,
        "relay" => Kind::Relay,
        "blink1" => Kind::Blink1,
        "bulk" => Kind::Bulk,
        "interlock" => Kind::Interlock,
        other => {
            return Err(format!("{other:?} cannot be emulated; give elliptec, grbl, relay, blink1, bulk or interlock"));
        }
    })
}

fn device(text: &str) -> Result<(Kind, PathBuf), String> {
    let (name, path) = text.split_once('=').ok_or_else(|| format!("{text:?} names no path; give KIND=PATH"))?;
    Ok((kind(name)?, path.into()))
}

fn fault(text: &str) -> Result<(Kind, ByteFault), String> {
    let mut parts = text.split(':');
    let of = kind(parts.next().unwrap_or_default())?;
    let name = parts.next().ok_or_else(|| format!("{text:?} names no fault; give KIND:FAULT[:AFTER[:TIMES]]"))?;
    let word = |kind: &ByteFaultKind| serde_json::to_value(kind).is_ok_and(|v| v == name);
    let kind = ByteFaultKind::ALL.into_iter().find(word).ok_or_else(|| format!("{name:?} is no fault"))?;
    let mut number =
        || parts.next().map(|n| n.parse().map_err(|_| format!("{n:?} is no number of commands"))).transpose();
    let (after, times) = (number()?.unwrap_or(0), number()?);
    Ok((of, ByteFault { kind, after, times }))
}

impl Emulated {
    /// Starts the emulated devices; each opens its own connection to the bench.
    ///
    /// # Errors
    /// The bench cannot be reached, or a port or socket cannot be created.
    pub fn start(&self, dial: impl Fn() -> DeviceResult<Box<dyn Port>>) -> Result<Attached, Failure> {
        let mut attached = Attached::default();
        for (kind, path) in &self.devices {
            let (port, faults) = (dial()?, self.faults_of(*kind));
            let bad = |e: std::io::Error| Error::output(path, e);
            let serve = |device| Served::start(path, device, faults.clone()).map_err(bad);
            match kind {
                Kind::Elliptec => {
                    let options = elliptec::Options {
                        pulses_per_turn: self.pulses_per_turn,
                        faults,
                        ..elliptec::Options::default()
                    };
                    attached.ports.push(Pty::start(path, elliptec::Elliptec::new(port, options)).map_err(bad)?);
                }
                Kind::Grbl => {
                    let options = grbl::Options { faults, ..grbl::Options::default() };
                    attached.ports.push(Pty::start(path, grbl::Grbl::new(port, options)).map_err(bad)?);
                }
                Kind::Relay => attached.sockets.push(serve(Box::new(RelayEmulator::new(port, *b"NACRE", 1, 1)))?),
                Kind::Blink1 => attached.sockets.push(serve(Box::new(Blink1Emulator::new(port)))?),
                Kind::Bulk => attached.sockets.push(serve(Box::new(BulkEmulator::new(port)))?),
                Kind::Interlock => attached.sockets.push(serve(Box::new(InterlockEmulator::new(port)))?),
            }
        }
        Ok(attached)
    }

    fn faults_of(&self, kind: Kind) -> Vec<ByteFault> {
        self.faults.iter().filter(|f| f.0 == kind).map(|f| f.1.clone()).collect()
    }

    /// Lists kind and path of each device for the terminal.
    pub fn text(&self) -> String {
        let names: Vec<String> =
            self.devices.iter().map(|(kind, path)| format!("{kind:?} at {}", path.display()).to_lowercase()).collect();
        names.join(", ")
    }
}

/// Emulates devices until Ctrl-C.
pub fn run(args: &Args, console: &Console) -> Result<(), Failure> {
    if args.emulated.devices.is_empty() {
        return Err(
            Error::input("--device", "is not given", "say what to emulate: --device elliptec=/tmp/stage").into()
        );
    }
    let socket: &Path = &args.socket;
    let _attached = args.emulated.start(|| Ok(Box::new(RemoteBench::connect(socket)?)))?;
    console.note(&format!("{}; Ctrl-C ends it", args.emulated.text()));
    while !console.cancelled() {
        std::thread::sleep(Duration::from_millis(20));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn devices_and_faults_are_read() {
        assert_eq!(device("relay=/a=b"), Ok((Kind::Relay, "/a=b".into())));
        let half = ByteFault { kind: ByteFaultKind::HalfAnswer, after: 3, times: Some(1) };
        assert_eq!(fault("elliptec:half_answer:3:1"), Ok((Kind::Elliptec, half)));
        for bad in ["elliptec", "robot:slow", "relay:sulks", "relay:slow:x", ""] {
            assert!(fault(bad).is_err(), "{bad}");
        }
        assert!(device("relay").is_err() && device("toaster=/x").is_err());
    }
}
