//! Checks whether this machine is fit for a bench, each with a remedy if it is not.

mod devices;
mod disk;
mod machine;
mod network;

use crate::discovery::{Root, discover_apart};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Result of one check.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Check {
    /// Name of the check.
    pub name: String,
    /// Severity.
    pub ok: Health,
    /// Finding.
    pub found: String,
    /// Instruction for the user; `None` if the check passed.
    pub remedy: Option<String>,
}

/// Severity of a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Health {
    /// The check passed.
    Ok,
    /// Trouble is possible.
    Warn,
    /// Trouble is certain.
    Bad,
}

impl Check {
    fn ok(name: &str, found: impl Into<String>) -> Self {
        Self { name: name.into(), ok: Health::Ok, found: found.into(), remedy: None }
    }

    fn not_ok(name: &str, ok: Health, found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { name: name.into(), ok, found: found.into(), remedy: Some(remedy.into()) }
    }

    /// Compares a value with two lower limits: below the first it is a warning, below the second an error.
    fn at_least(name: &str, value: f64, [warn, bad]: [f64; 2], found: String, remedy: &str) -> Self {
        match value {
            v if v >= warn => Self::ok(name, found),
            v if v >= bad => Self::not_ok(name, Health::Warn, found, remedy),
            _ => Self::not_ok(name, Health::Bad, found, remedy),
        }
    }
}

/// Runs all checks. `folder` is the folder of the measurements; 64 MiB are written there and removed again.
pub fn examine(root: &Root, folder: &Path) -> Vec<Check> {
    let (mut found, cameras) = discover_apart(root);
    let networks = network::cameras(root, &cameras);
    found.extend(cameras.into_iter().map(|camera| camera.found));
    let mut checks = vec![machine::versions(root), machine::resolution(), machine::date(), machine::memory(root)];
    checks.extend([disk::space(folder), disk::speed(folder, disk::AMOUNT)]);
    checks.extend(machine::governor(root));
    checks.push(devices::bandwidth(&found));
    checks.extend(networks);
    checks.extend(network::usb_memory(root, &found));
    checks.extend(devices::blanking(root, &found, &crate::display::desktop_warnings()));
    checks.extend(devices::access(&found));
    checks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_check_that_is_not_ok_has_a_remedy() {
        let folder = tempfile::tempdir().unwrap();
        for root in [Root::default(), Root::under(folder.path())] {
            let checks = examine(&root, folder.path());
            assert!(checks.len() >= 7);
            for check in checks {
                assert_eq!(check.ok == Health::Ok, check.remedy.is_none(), "{check:?}");
                assert!(!check.found.is_empty(), "{check:?}");
            }
        }
    }

    #[test]
    fn limits_are_two() {
        let health = |value| Check::at_least("x", value, [10.0, 5.0], String::new(), "").ok;
        assert_eq!([10.0, 9.0, 5.0, 4.0, f64::NAN].map(health), {
            use Health::{Bad, Ok, Warn};
            [Ok, Warn, Warn, Bad, Bad]
        });
    }
}
