//! Suitability of the detected devices for a bench.

use super::{Check, Health};
use crate::discovery::{Access, Found, Kind, Root, text};
use std::collections::BTreeMap;

/// Speed of USB 2 in Mbit/s: one camera with uncompressed pictures saturates it.
const USB_2: f64 = 480.0;

/// Checks for cameras that share a USB 2 bus and thus lose frames to each other.
pub(super) fn bandwidth(found: &[Found]) -> Check {
    let mut buses: BTreeMap<u16, Vec<&str>> = BTreeMap::new();
    for camera in found.iter().filter(|f| f.kind == Kind::Camera) {
        if let Some(usb) = camera.usb.as_ref().filter(|usb| usb.speed_mbit <= USB_2) {
            buses.entry(usb.bus).or_default().push(&camera.what);
        }
    }
    match buses.into_iter().find(|(_, cameras)| cameras.len() > 1) {
        None => Check::ok("USB bandwidth", "no cameras share a slow bus"),
        Some((bus, cameras)) => {
            let found = format!("{} cameras share bus {bus} of USB 2: {}", cameras.len(), cameras.join(", "));
            let remedy = "plug one of them into a port of another bus (`lsusb -t` shows them), or into USB 3";
            Check::not_ok("USB bandwidth", Health::Warn, found, remedy)
        }
    }
}

/// Checks for screen blanking, which spoils a measurement. The desktop's settings cannot be read reliably.
pub(super) fn blanking(root: &Root, found: &[Found], meddlers: &[String]) -> Vec<Check> {
    let name = "screen blanking";
    let mut checks = vec![];
    if !found.iter().any(|f| f.kind == Kind::Display) {
        return checks;
    }
    let console = text(&root.sys.join("module/kernel/parameters/consoleblank")).and_then(|t| t.parse::<u64>().ok());
    if let Some(seconds) = console.filter(|s| *s > 0) {
        let found = format!("the console goes dark after {seconds} s");
        checks.push(Check::not_ok(name, Health::Warn, found, "run `setterm --blank 0`, or boot with consoleblank=0"));
    }
    checks.extend(meddlers.iter().map(|warning| {
        let (found, remedy) = warning.split_once(": ").unwrap_or((warning, "end it"));
        Check::not_ok(name, Health::Warn, found, remedy)
    }));
    if checks.is_empty() {
        checks.push(Check::ok(name, "nothing is known to make screens dark"));
    }
    checks
}

/// Checks the access rights of each device.
pub(super) fn access(found: &[Found]) -> Vec<Check> {
    let words = |device: &Found| match &device.node {
        Some(node) => format!("{} at {}", device.what, node.display()),
        None => device.what.clone(),
    };
    let found: Vec<&Found> = found.iter().filter(|f| f.kind != Kind::Other).collect();
    let check = |device: &&Found| {
        // A browser may drive the display instead, and a device of uncertain role may not be needed.
        let needed = device.sure && device.kind != Kind::Display;
        let health = if needed { Health::Bad } else { Health::Warn };
        let name = format!("access to {}", device.id);
        match &device.access {
            Access::Open | Access::NotNeeded => Check::ok(&name, words(device)),
            Access::Denied { remedy } => {
                Check::not_ok(&name, health, format!("{} may not be opened", words(device)), remedy)
            }
            Access::InUse { remedy } => {
                Check::not_ok(&name, Health::Warn, format!("{} is in use", words(device)), remedy)
            }
            Access::NoNode { remedy } => {
                Check::not_ok(&name, health, format!("{} has no device node", words(device)), remedy)
            }
        }
    };
    if found.is_empty() {
        return vec![Check::not_ok("devices", Health::Warn, "none", "plug them in; a simulated bench needs none")];
    }
    found.iter().map(check).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discovery::Usb;

    fn camera(bus: u16, speed_mbit: f64) -> Found {
        let usb = Usb {
            vendor: 1,
            product: 2,
            manufacturer: None,
            name: None,
            serial: None,
            bus,
            address: 3,
            port: "1-1".into(),
            speed_mbit,
        };
        Found {
            kind: Kind::Camera,
            what: format!("camera on {bus}"),
            id: "0001:0002 at 1-1".into(),
            node: Some("/dev/video0".into()),
            stable: None,
            size_mm: None,
            usb: Some(usb),
            setting: None,
            sure: true,
            access: Access::Denied { remedy: "join the group video".into() },
        }
    }

    #[test]
    fn cameras_on_one_slow_bus_are_noticed() {
        let ok = |cameras: &[Found]| bandwidth(cameras).ok;
        assert_eq!(ok(&[]), Health::Ok);
        assert_eq!(ok(&[camera(1, 480.0), camera(2, 480.0)]), Health::Ok);
        assert_eq!(ok(&[camera(1, 5000.0), camera(1, 480.0)]), Health::Ok);
        assert_eq!(ok(&[camera(1, 480.0), camera(1, 480.0)]), Health::Warn);
    }

    #[test]
    fn a_device_that_may_not_be_opened_is_bad() {
        let checks = access(&[camera(1, 480.0)]);
        assert_eq!(checks[0].ok, Health::Bad);
        assert_eq!(checks[0].remedy.as_deref(), Some("join the group video"));
        assert_eq!(access(&[])[0].ok, Health::Warn);
    }

    #[test]
    fn screens_that_go_dark_are_noticed_where_there_is_one() {
        let folder = tempfile::tempdir().unwrap();
        let root = Root::under(folder.path());
        let warning = ["redshift tints the screen: end it".to_owned()];
        assert!(blanking(&root, &[], &warning).is_empty());
        let panel = [Found { kind: Kind::Display, ..camera(1, 0.0) }];
        assert_eq!(blanking(&root, &panel, &[])[0].ok, Health::Ok);
        let parameters = root.sys.join("module/kernel/parameters");
        std::fs::create_dir_all(&parameters).unwrap();
        std::fs::write(parameters.join("consoleblank"), "600\n").unwrap();
        let checks = blanking(&root, &panel, &warning);
        assert!(checks.len() == 2 && checks.iter().all(|c| c.ok == Health::Warn));
    }
}
