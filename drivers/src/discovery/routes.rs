//! Network interfaces on the way to a camera.

use super::sysfs::{Root, bytes};
use std::net::Ipv4Addr;

/// Interface whose network contains this address; `None` if packets to it take a gateway or no way.
pub fn interface(root: &Root, address: Ipv4Addr) -> Option<String> {
    if address.is_loopback() {
        return Some("lo".into());
    }
    let table = bytes(&root.proc.join("net/route"))?;
    direct(&String::from_utf8_lossy(&table), address)
}

/// The most specific direct route in the kernel's table.
fn direct(table: &str, address: Ipv4Addr) -> Option<String> {
    let route = |line: &str| {
        let fields: Vec<&str> = line.split_whitespace().collect();
        // The kernel writes addresses in the byte order of the machine.
        let word = |at: usize| u32::from_str_radix(fields.get(at)?, 16).ok().map(u32::to_ne_bytes).map(Ipv4Addr::from);
        let (destination, gateway, mask) = (word(1)?, word(2)?, word(7)?);
        let prefix = mask.to_bits().count_ones();
        let within = address.to_bits() & mask.to_bits() == destination.to_bits();
        (within && prefix > 0 && gateway.is_unspecified()).then(|| (prefix, fields[0].to_owned()))
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
        assert_eq!(at(10, 0, 0, 1), None, "only through a gateway");
        assert_eq!(interface(&Root::default(), Ipv4Addr::LOCALHOST).as_deref(), Some("lo"));
    }
}
