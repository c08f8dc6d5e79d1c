//! Interlocks: conditions that must hold while anything moves or emits light.

use nacre_drivers::{Class, DeviceError, DeviceResult, Interlock};
use std::time::Duration;
use tokio::sync::Mutex;

/// Polling interval of the interlocks.
const PERIOD: Duration = Duration::from_millis(50);

/// Monitors interlocks. An interlock that opened and closed again counts as open until it is acknowledged.
#[derive(Default)]
pub struct Watch {
    interlocks: Mutex<Vec<Watched>>,
}

struct Watched {
    interlock: Box<dyn Interlock>,
    /// Number of changes at the last acknowledgement.
    changes: Option<u64>,
}

impl Watch {
    /// Monitors these interlocks.
    pub fn new(interlocks: Vec<Box<dyn Interlock>>) -> Self {
        let watched = interlocks.into_iter().map(|interlock| Watched { interlock, changes: None });
        Self { interlocks: Mutex::new(watched.collect()) }
    }

    /// Checks all interlocks once.
    ///
    /// # Errors
    /// `Stop` if one is open, was open since the last acknowledgement, or does not answer.
    pub async fn check(&self) -> DeviceResult<()> {
        for watched in self.interlocks.lock().await.iter_mut() {
            watched.check().await?;
        }
        Ok(())
    }

    /// Returns as soon as an interlock opens.
    pub(crate) async fn broken(&self) -> DeviceError {
        loop {
            if let Err(error) = self.check().await {
                return error;
            }
            tokio::time::sleep(PERIOD).await;
        }
    }

    /// Acknowledges interlocks that opened while nothing moved or emitted light; the next check starts afresh.
    pub async fn begin_again(&self) {
        self.interlocks.lock().await.iter_mut().for_each(|watched| watched.changes = None);
    }

    /// Identities, and the present state of each; `None` for one that does not answer.
    pub async fn levels(&self) -> Vec<(String, Option<bool>)> {
        let mut levels = vec![];
        for watched in self.interlocks.lock().await.iter_mut() {
            let holds = watched.interlock.level().await.ok().map(|l| l.holds);
            levels.push((watched.interlock.describe().id, holds));
        }
        levels
    }

    /// Identities of the interlocks.
    pub async fn ids(&self) -> Vec<String> {
        self.interlocks.lock().await.iter().map(|w| w.interlock.describe().id).collect()
    }
}

impl Watched {
    async fn check(&mut self) -> DeviceResult<()> {
        let level = self.interlock.level().await.map_err(|e| e.class(Class::Stop))?;
        let before = *self.changes.get_or_insert(level.changes);
        let got = match (level.holds, level.changes == before) {
            (true, true) => return Ok(()),
            (true, false) => "an interlock that opened and closed again",
            (false, _) => "an open interlock",
        };
        let id = self.interlock.describe().id;
        Err(DeviceError::new(&id, "hold", "a closed interlock", got).remedy("close it, then resume the session"))
    }
}
