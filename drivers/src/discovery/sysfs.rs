//! Bounded reading of the kernel's device tree. Missing or malformed entries mean no device, never an error.

use serde::{Deserialize, Serialize};
use std::io::Read;
use std::path::{Path, PathBuf};

/// Maximum size of a file in bytes; EDIDs are the longest.
const MAX_FILE: u64 = 64 * 1024;

/// Maximum number of entries read from a folder.
const MAX_ENTRIES: usize = 4096;

/// Paths of the system's folders, replaceable in tests.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Root {
    /// The kernel's device tree.
    pub sys: PathBuf,
    /// Device nodes.
    pub dev: PathBuf,
    /// Processes and kernel state.
    pub proc: PathBuf,
    /// Groups and users.
    pub etc: PathBuf,
}

impl Default for Root {
    fn default() -> Self {
        Self::under(Path::new("/"))
    }
}

impl Root {
    /// A machine whose folders all lie under one folder.
    pub fn under(folder: &Path) -> Self {
        Self { sys: folder.join("sys"), dev: folder.join("dev"), proc: folder.join("proc"), etc: folder.join("etc") }
    }
}

/// Content of a small file.
pub(crate) fn bytes(path: &Path) -> Option<Vec<u8>> {
    let mut read = Vec::new();
    std::fs::File::open(path).ok()?.take(MAX_FILE).read_to_end(&mut read).ok()?;
    Some(read)
}

/// Text of a small file without surrounding white space; `None` if it is empty or missing.
pub(crate) fn text(path: &Path) -> Option<String> {
    let text = String::from_utf8_lossy(&bytes(path)?).trim().to_owned();
    (!text.is_empty()).then_some(text)
}

/// Entries of a folder, sorted by name with numeric order.
pub(crate) fn entries(folder: &Path) -> Vec<PathBuf> {
    let Ok(found) = std::fs::read_dir(folder) else { return vec![] };
    let mut paths: Vec<PathBuf> = found.take(MAX_ENTRIES).flatten().map(|e| e.path()).collect();
    paths.sort_by_key(|path| {
        let name = name(path);
        let stem = name.trim_end_matches(|c: char| c.is_ascii_digit()).len();
        let (stem, number) = name.split_at(stem);
        (stem.to_owned(), number.parse::<u64>().unwrap_or(0), name.clone())
    });
    paths
}

/// Last component of a path.
pub(crate) fn name(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned())
}

/// A USB device.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Usb {
    /// Vendor ID.
    pub vendor: u16,
    /// Product ID.
    pub product: u16,
    /// Manufacturer string.
    pub manufacturer: Option<String>,
    /// Product string.
    pub name: Option<String>,
    /// Serial number; many cheap devices have none, or share one.
    pub serial: Option<String>,
    /// Bus number.
    pub bus: u16,
    /// Address on the bus, which changes each time the device is plugged in.
    pub address: u16,
    /// Port path, such as `1-4.2`.
    pub port: String,
    /// Speed in Mbit/s.
    pub speed_mbit: f64,
}

impl Usb {
    /// The USB device at this folder of the tree.
    pub(crate) fn at(folder: &Path) -> Option<Self> {
        let hex = |file: &str| u16::from_str_radix(&text(&folder.join(file))?, 16).ok();
        let number = |file: &str| text(&folder.join(file)).and_then(|t| t.parse().ok()).unwrap_or(0);
        Some(Self {
            vendor: hex("idVendor")?,
            product: hex("idProduct")?,
            manufacturer: text(&folder.join("manufacturer")),
            name: text(&folder.join("product")),
            serial: text(&folder.join("serial")),
            bus: number("busnum"),
            address: number("devnum"),
            port: name(folder),
            speed_mbit: text(&folder.join("speed")).and_then(|t| t.parse().ok()).filter(|s| *s > 0.0).unwrap_or(0.0),
        })
    }

    /// The USB device that a device of another class belongs to.
    pub(crate) fn of(root: &Root, device: &Path) -> Option<Self> {
        let (device, sys) = (device.canonicalize().ok()?, root.sys.canonicalize().ok()?);
        device.ancestors().take_while(|folder| folder.starts_with(&sys)).find_map(Self::at)
    }

    /// Device node.
    pub fn node(&self, root: &Root) -> PathBuf {
        root.dev.join(format!("bus/usb/{:03}/{:03}", self.bus, self.address))
    }

    /// Vendor and product IDs in the usual notation.
    pub fn numbers(&self) -> String {
        format!("{:04x}:{:04x}", self.vendor, self.product)
    }

    /// Human-readable name.
    pub fn words(&self) -> String {
        let names = [self.manufacturer.as_deref(), self.name.as_deref()];
        let names: Vec<&str> = names.into_iter().flatten().collect();
        if names.is_empty() { "USB device".into() } else { names.join(" ") }
    }

    /// IDs with the serial number, or with the port if there is none.
    pub fn identity(&self) -> String {
        match &self.serial {
            Some(serial) => format!("{} {serial}", self.numbers()),
            None => format!("{} at {}", self.numbers(), self.port),
        }
    }
}
