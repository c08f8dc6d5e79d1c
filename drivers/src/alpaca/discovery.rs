//! Alpaca servers on the local networks: a broadcast over UDP, which servers answer with their port.

use super::client::{self, Listed, Role};
use crate::discovery::{Access, Found, Kind, Root, broadcast_addresses, quoted};
use serde::Deserialize;
use std::collections::BTreeSet;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

/// Port of the discovery protocol.
const PORT: u16 = 32227;
const QUESTION: &[u8] = b"alpacadiscovery1";
/// Time for answers.
const ANSWERS: Duration = Duration::from_millis(500);
/// Time for a server's list of devices.
const LIST: Duration = Duration::from_millis(400);
/// Largest number of servers.
const MAX_SERVERS: usize = 64;

#[derive(Deserialize)]
#[serde(rename_all = "PascalCase")]
struct Reply {
    alpaca_port: u16,
}

/// Port of the server that sent this datagram; `None` for any other datagram.
pub fn port(datagram: &[u8]) -> Option<u16> {
    serde_json::from_slice::<Reply>(datagram).ok().map(|reply| reply.alpaca_port).filter(|port| *port > 0)
}

/// Servers that answer on the networks of this computer.
fn servers(root: &Root) -> Vec<SocketAddr> {
    let mut found = BTreeSet::new();
    let Ok(socket) = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)) else { return vec![] };
    if socket.set_broadcast(true).is_err() {
        return vec![];
    }
    let own = [Ipv4Addr::LOCALHOST, Ipv4Addr::BROADCAST];
    for address in own.into_iter().chain(broadcast_addresses(root)) {
        // A network without an interface that is up refuses it.
        let _ = socket.send_to(QUESTION, (address, PORT));
    }
    let (begun, mut datagram) = (Instant::now(), [0; 512]);
    while let Some(left) = ANSWERS.checked_sub(begun.elapsed()).filter(|left| !left.is_zero()) {
        if socket.set_read_timeout(Some(left)).is_err() || found.len() >= MAX_SERVERS {
            break;
        }
        let Ok((count, from)) = socket.recv_from(&mut datagram) else { continue };
        if let Some(port) = datagram.get(..count).and_then(port) {
            found.insert(SocketAddr::new(from.ip(), port));
        }
    }
    // A server of this computer answers on each of its addresses; one suffices.
    let local: BTreeSet<u16> = found.iter().filter(|a| a.ip().is_loopback()).map(SocketAddr::port).collect();
    let again = |a: &SocketAddr| !a.ip().is_loopback() && is_own(a.ip()) && local.contains(&a.port());
    found.into_iter().filter(|address| !again(address)).collect()
}

/// Whether an address belongs to this computer.
fn is_own(address: IpAddr) -> bool {
    UdpSocket::bind((address, 0)).is_ok()
}

/// Rotators, cameras and switches of the servers that answer.
pub(crate) fn found(root: &Root) -> Vec<Found> {
    let asked: Vec<_> =
        servers(root).into_iter().map(|server| std::thread::spawn(move || found_at(&server.to_string()))).collect();
    asked.into_iter().flat_map(|asked| asked.join().unwrap_or_default()).collect()
}

/// Rotators, cameras and switches of a server.
pub fn found_at(address: &str) -> Vec<Found> {
    let Ok((host, port)) = crate::net::host_and_port(address, super::PORT) else { return vec![] };
    let listed = client::list(host, port, "ClientID=1&ClientTransactionID=1", LIST).unwrap_or_default();
    listed.iter().take(256).filter_map(|listed| device(address, listed)).collect()
}

fn device(address: &str, listed: &Listed) -> Option<Found> {
    let is = |role: Role| listed.device_type.eq_ignore_ascii_case(role.word());
    let (kind, role) = match () {
        () if is(Role::Rotator) => (Kind::Stage, Role::Rotator),
        () if is(Role::Camera) => (Kind::Camera, Role::Camera),
        () if is(Role::Switch) => (Kind::Flash, Role::Switch),
        () => return None,
    };
    let (word, number) = (role.word(), listed.device_number);
    Some(Found {
        kind,
        what: format!("Alpaca {word} {} at {address}", client::short(&listed.device_name)),
        id: client::short(&listed.unique_id),
        node: None,
        stable: None,
        size_mm: None,
        usb: None,
        setting: Some(format!("{{ kind = \"alpaca\", address = {}, {word} = {number} }}", quoted(address))),
        // A switch may switch anything.
        sure: role != Role::Switch,
        access: Access::NotNeeded,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_answers_of_servers_count() {
        assert_eq!(port(br#"{"AlpacaPort":11111}"#), Some(11_111));
        for other in
            [&b"alpacadiscovery1"[..], b"", b"{}", br#"{"AlpacaPort":0}"#, br#"{"AlpacaPort":70000}"#, &[0; 512]]
        {
            assert_eq!(port(other), None);
        }
    }

    #[test]
    fn devices_have_a_driver_line() {
        let listed = |device_type: &str| Listed {
            device_name: "A\nB".into(),
            device_type: device_type.into(),
            device_number: 2,
            unique_id: "u".into(),
        };
        let found = device("10.0.0.7:80", &listed("Rotator")).unwrap();
        assert_eq!(
            (found.kind, found.sure, found.what.as_str()),
            (Kind::Stage, true, "Alpaca rotator A B at 10.0.0.7:80")
        );
        assert_eq!(found.setting.unwrap(), "{ kind = \"alpaca\", address = \"10.0.0.7:80\", rotator = 2 }");
        assert!(!device("a", &listed("switch")).unwrap().sure);
        assert_eq!(device("a", &listed("Telescope")), None);
    }
}
