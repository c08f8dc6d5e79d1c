//! What the service tells systemd: that it is ready, that it stops, and that it is alive (sd_notify; units with `Type=notify` and `WatchdogSec=`).
//! Nothing is told where nobody listens (no `NOTIFY_SOCKET`).

use sd_notify::NotifyState::{self, Ready, Status, Stopping, Watchdog};
use std::net::SocketAddr;

/// It answers requests from now on. The watchdog is told twice in each of its intervals that it does.
pub fn ready(address: SocketAddr) {
    tell(&[Ready, Status(&format!("answers at http://{address}"))]);
    if let Some(interval) = sd_notify::watchdog_enabled() {
        tokio::spawn(async move {
            loop {
                // Requests that read files or compute wait for the threads that this asks.
                if tokio::task::spawn_blocking(|| ()).await.is_ok() {
                    tell(&[Watchdog]);
                }
                tokio::time::sleep(interval / 2).await;
            }
        });
    }
}

/// It ends, which may take as long as requests in progress.
pub fn stopping() {
    tell(&[Stopping]);
}

fn tell(states: &[NotifyState]) {
    if let Err(error) = sd_notify::notify(states) {
        tracing::warn!("systemd is not told {states:?}: {error}");
    }
}
