//! Several modules on one bus: if the configured one does not answer, the error names the others.

use super::Elliptec;
use super::protocol::{Address, Command, Reply, parse};
use crate::{Class, DeviceResult};
use std::time::Duration;

/// Addresses on a bus.
const ADDRESSES: &str = "0123456789ABCDEF";

/// Time limit for an identity, which takes 35 ms at the bus' baud rate, during a search for other modules.
const SCAN: Duration = Duration::from_millis(120);

impl Elliptec {
    /// Identifies the module. If another one answers, or none, the error names all modules on the bus.
    pub(super) async fn identify(&mut self) -> DeviceResult<()> {
        match self.identify_module().await {
            Err(error) if matches!(error.class, Class::Retry | Class::Setup) => {
                let found = self.modules().await;
                if found.is_empty() {
                    return Err(error);
                }
                let remedy = format!("set `address` of the stage; this bus has {}", found.join("; "));
                Err(error.remedy(remedy).class(Class::Setup))
            }
            other => other,
        }
    }

    /// Address, model and serial number of each other module on the bus that answers.
    async fn modules(&mut self) -> Vec<String> {
        const WHAT: &str = "find other modules";
        let mut found = vec![];
        for address in ADDRESSES.chars().filter_map(|digit| Address::try_from(digit).ok()) {
            if address == self.settings.address || self.lines.clear(WHAT).is_err() {
                continue;
            }
            if self.lines.send(WHAT, &Command::Identity.encode(address)).is_err() {
                break;
            }
            let until = self.lines.now() + SCAN;
            while let Ok(Some(line)) = self.lines.next(WHAT, until).await {
                if let Some((from, Reply::Identity(identity))) = parse(&line)
                    && from == address
                {
                    let kind = identity.not_rotary().map_or_else(String::new, |kind| format!(" ({kind})"));
                    let (name, digit) = (identity.name(), char::from(address));
                    found.push(format!("{name}{kind} s/n {} at address {digit}", identity.serial));
                    break;
                }
            }
        }
        found
    }
}
