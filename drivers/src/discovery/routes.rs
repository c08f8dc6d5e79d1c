//! Network interfaces on the way to a camera.

use super::sysfs::{Root, bytes};
use std::net::Ipv4Addr;

/// Largest number of networks that are asked.
const MAX_NETWORKS: usize = 32;

/// Interface whose network contains this address; `None` if packets to it take a gateway or no way.
pub fn interface(root: &Root, address: Ipv4Addr) -> Option<String> {
    if address.is_loopback() {
        return Some("lo".into());
    }
    let table = bytes(&root.proc.join("net/route"))?;
    direct(&String::from_utf8_lossy(&table), address)
}

/// Broadcast addresses of the networks of this computer.
pub(crate) fn broadcast_addresses(root: &Root) -> Vec<Ipv4Addr> {
    let table = bytes(&root.proc.join("net/route")).unwrap_or_default();
    broadcasts(&String::from_utf8_lossy(&table))
}

fn broadcasts(table: &str) -> Vec<Ipv4Addr> {
    let route = |line: &str| {
        let Route { destination, gateway, mask, .. } = Route::read(line)?;
        let network = (8..=30).contains(&mask.to_bits().count_ones()) && gateway.is_unspecified();
        network.then(|| Ipv4Addr::from_bits(destination.to_bits() | !mask.to_bits()))
    };
    table.lines().filter_map(route).take(MAX_NETWORKS).collect()
}

/// A line of the kernel's table.
struct Route<'a> {
    interface: &'a str,
    destination: Ipv4Addr,
    gateway: Ipv4Addr,
    mask: Ipv4Addr,
}

impl<'a> Route<'a> {
    fn read(line: &'a str) -> Option<Self> {
        let fields: Vec<&str> = line.split_whitespace().collect();
        // The kernel writes addresses in the byte order of the machine.
        let word = |at: usize| u32::from_str_radix(fields.get(at)?, 16).ok().map(u32::to_ne_bytes).map(Ipv4Addr::from);
        Some(Self { interface: fields.first()?, destination: word(1)?, gateway: word(2)?, mask: word(7)? })
    }
}

/// The most specific direct route in the kernel's table.
fn direct(table: &str, address: Ipv4Addr) -> Option<String> {
    let route = |line: &str| {
        let Route { interface, destination, gateway, mask } = Route::read(line)?;
        let prefix = mask.to_bits().count_ones();
        let within = address.to_bits() & mask.to_bits() == destination.to_bits();
        (within && prefix > 0 && gateway.is_unspecified()).then(|| (prefix, interface.to_owned()))
    };
    table.lines().filter_map(route).max_by_key(|(prefix, _)| *prefix).map(|(_, interface)| interface)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(target_endian = "little")]
    fn the_most_specific_direct_route_counts() {
        let table = "Iface Destination Gateway Flags RefCnt Use Metric Mask MTU Window IRTT\n\
                     eth0 00000000 010200C0 0003 0 0 0 00000000 0 0 0\n\
                     eth0 000200C0 00000000 0001 0 0 0 00FFFFFF 0 0 0\n\
                     eth1 0000FEA9 00000000 0001 0 0 0 0000FFFF 0 0 0\n\
                     eth2 0001FEA9 00000000 0001 0 0 0 00FFFFFF 0 0 0\nbroken\n";
        let at = |a, b, c, d| direct(table, Ipv4Addr::new(a, b, c, d));
        assert_eq!(at(192, 0, 2, 9).as_deref(), Some("eth0"));
        assert_eq!(at(169, 254, 7, 1).as_deref(), Some("eth1"));
        assert_eq!(at(169, 254, 1, 7).as_deref(), Some("eth2"));
        let broadcasts: Vec<String> = broadcasts(table).iter().map(ToString::to_string).collect();
        assert_eq!(broadcasts, ["192.0.2.255", "169.254.255.255", "169.254.1.255"]);
        assert_eq!(at(10, 0, 0, 1), None, "only through a gateway");
        assert_eq!(interface(&Root::default(), Ipv4Addr::LOCALHOST).as_deref(), Some("lo"));
    }
}
