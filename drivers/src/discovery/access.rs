//! Access rights of this process to a device, and remedies for missing rights.

use super::sysfs::{Root, text};
use crate::{DeviceError, DeviceResult};
use rustix::fs::Access as Mode;
use serde::{Deserialize, Serialize};
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// Access to a device node.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "access", rename_all = "snake_case")]
pub enum Access {
    /// The node may be read and written.
    Open,
    /// The node exists but may not be opened.
    Denied {
        /// Instruction for the user.
        remedy: String,
    },
    /// The kernel knows the device, but its node is missing, as in a container without it.
    NoNode {
        /// Instruction for the user.
        remedy: String,
    },
    /// Another program controls the device.
    InUse {
        /// Instruction for the user.
        remedy: String,
    },
    /// The device needs no node.
    NotNeeded,
}

impl Access {
    /// Instruction for the user, if access is missing.
    pub fn remedy(&self) -> Option<&str> {
        match self {
            Self::Denied { remedy } | Self::NoNode { remedy } | Self::InUse { remedy } => Some(remedy),
            Self::Open | Self::NotNeeded => None,
        }
    }
}

/// Checks whether the node may be read and written.
pub fn check(root: &Root, node: &Path) -> Access {
    match rustix::fs::access(node, Mode::READ_OK | Mode::WRITE_OK) {
        Ok(()) => Access::Open,
        Err(rustix::io::Errno::NOENT) => {
            Access::NoNode { remedy: format!("make {} visible in the container (docker run --device)", node.display()) }
        }
        Err(_) => Access::Denied { remedy: remedy(node, group(root, node).as_deref()) },
    }
}

/// Refuses a node that is missing, with the remedy `missing`, or that this process may not open.
///
/// # Errors
/// As `cannot` makes them.
pub fn require(node: &str, missing: &str, cannot: impl Fn(String) -> DeviceError) -> DeviceResult<()> {
    match check(&Root::default(), Path::new(node)) {
        Access::Denied { remedy } => Err(cannot("no permission".into()).remedy(remedy)),
        Access::NoNode { .. } => Err(cannot("no such device".into()).remedy(missing)),
        Access::Open | Access::InUse { .. } | Access::NotNeeded => Ok(()),
    }
}

/// Instruction for access to a node of this group.
pub fn remedy(node: &Path, group: Option<&str>) -> String {
    match group {
        Some(group) => format!("run `sudo usermod -aG {group} $USER`, then log out and in again"),
        None => format!(
            "{} belongs to root alone: install the udev rules of Nacre as {RULES_PATH}, run `sudo udevadm control \
             --reload`, then plug the device in again",
            node.display()
        ),
    }
}

/// Path of the udev rules.
pub const RULES_PATH: &str = "/etc/udev/rules.d/70-nacre.rules";

/// The group that may read and write the node, if it is a group for users.
fn group(root: &Root, node: &Path) -> Option<String> {
    let found = std::fs::metadata(node).ok()?;
    let (gid, mode) = (found.gid(), found.mode());
    if gid == 0 || mode & 0o060 != 0o060 {
        return None;
    }
    group_name(&text(&root.etc.join("group"))?, gid)
}

fn group_name(groups: &str, gid: u32) -> Option<String> {
    groups.lines().find_map(|line| {
        let mut fields = line.split(':');
        let (name, number) = (fields.next()?, fields.nth(1)?);
        (number.parse() == Ok(gid)).then(|| name.to_owned())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_group_is_found_by_its_number() {
        let groups = "root:x:0:\ndialout:x:20:ada\nbroken\n:::\nvideo:x:44:\n";
        assert_eq!(group_name(groups, 20).as_deref(), Some("dialout"));
        assert_eq!(group_name(groups, 21), None);
    }

    #[test]
    fn remedies_name_the_group_or_the_rules() {
        let node = Path::new("/dev/ttyUSB0");
        assert!(remedy(node, Some("dialout")).contains("usermod -aG dialout"));
        assert!(remedy(node, None).contains(RULES_PATH));
        let missing = check(&Root::default(), Path::new("/dev/no such node"));
        assert!(missing.remedy().unwrap().contains("container"));
    }
}
