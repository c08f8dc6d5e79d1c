//! Notifications to systemd: ready, stopping and watchdog (sd_notify; units with `Type=notify` and `WatchdogSec=`).
//! Without `NOTIFY_SOCKET` there are none.

use sd_notify::NotifyState::{self, Ready, Status, Stopping, Watchdog};
use std::net::SocketAddr;

/// Notifies that the service answers requests, then feeds the watchdog twice per interval.
pub fn ready(address: SocketAddr) {
    tell(&[Ready, Status(&format!("answers at http://{address}"))]);
    if let Some(interval) = sd_notify::watchdog_enabled() {
        tokio::spawn(async move {
            loop {
                // Requests that read files or compute need these threads, so the watchdog tests them.
                if tokio::task::spawn_blocking(|| ()).await.is_ok() {
                    tell(&[Watchdog]);
                }
                tokio::time::sleep(interval / 2).await;
            }
        });
    }
}

/// Notifies that the service stops, which may take as long as requests in progress.
pub fn stopping() {
    tell(&[Stopping]);
}

fn tell(states: &[NotifyState]) {
    if let Err(error) = sd_notify::notify(states) {
        tracing::warn!("cannot notify systemd of {states:?}: {error}");
    }
}
