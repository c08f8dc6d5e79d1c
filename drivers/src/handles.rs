//! Devices on their own threads, behind the device traits: the interface to the engine.
//!
//! Each call has a time limit: the nominal time of the device plus [`MARGIN`].

use crate::actor::{Actor, Connect, Patience, Pending};
use crate::{
    Arrived, Camera, CameraInfo, Controls, DeviceResult, Display, DisplayInfo, Flash, FlashInfo, Frame, Freshness,
    Interlock, InterlockInfo, Level, Pattern, Shown, Stage, StageInfo, Switched,
};
use async_trait::async_trait;
use std::time::Duration;

/// Allowance beyond a device's nominal time, within which a simulated device renders.
pub const MARGIN: Duration = Duration::from_secs(60);

/// Time limit for a photograph that a person takes.
const BY_HAND: Duration = Duration::from_secs(24 * 3600);

/// A device with its description.
pub struct Handle<D: ?Sized, Info> {
    actor: Actor<D>,
    info: Info,
}

/// A rotation stage on its own thread.
pub type StageHandle = Handle<dyn Stage, StageInfo>;
/// A camera on its own thread.
pub type CameraHandle = Handle<dyn Camera, CameraInfo>;
/// A display on its own thread.
pub type DisplayHandle = Handle<dyn Display, DisplayInfo>;
/// A flash on its own thread.
pub type FlashHandle = Handle<dyn Flash, FlashInfo>;
/// An interlock on its own thread.
pub type InterlockHandle = Handle<dyn Interlock, InterlockInfo>;

macro_rules! start {
    ($device:ident, $info:ident, $what:literal) => {
        impl Handle<dyn $device, $info> {
            #[doc = concat!("Connects ", $what, ".")]
            /// # Errors
            /// As `connect`.
            pub async fn start(connect: Connect<dyn $device>, patience: Patience) -> DeviceResult<Self> {
                let (actor, info) = Actor::start(connect, |d| d.describe().id, |d| d.describe(), patience).await?;
                Ok(Self { actor, info })
            }
        }
    };
}
start!(Stage, StageInfo, "a rotation stage");
start!(Camera, CameraInfo, "a camera");
start!(Display, DisplayInfo, "a panel");
start!(Flash, FlashInfo, "a flash");
start!(Interlock, InterlockInfo, "an interlock");

impl StageHandle {
    fn limit(&self) -> Duration {
        MARGIN + Duration::from_secs_f64(self.info.longest_s.clamp(0.0, 1e6))
    }
}

#[async_trait]
impl Stage for StageHandle {
    fn describe(&self) -> StageInfo {
        self.info.clone()
    }

    async fn home(&mut self) -> DeviceResult<Arrived> {
        self.actor.interruptible("home", self.limit(), |d| d.home(), |d| d.halt()).await
    }

    async fn move_to(&mut self, angle_deg: f64) -> DeviceResult<Arrived> {
        let command = format!("move to {angle_deg}°");
        self.actor.interruptible(&command, self.limit(), move |d| d.move_to(angle_deg), |d| d.halt()).await
    }

    async fn halt(&mut self) -> DeviceResult<()> {
        self.actor.call("halt", self.limit(), |d| d.halt()).await
    }

    async fn position(&mut self) -> DeviceResult<f64> {
        self.actor.call("report its position", MARGIN, |d| d.position()).await
    }
}

impl CameraHandle {
    /// Frames of the longest exposure may still be in the queue.
    fn limit(&self) -> Duration {
        if self.info.by_hand {
            return BY_HAND;
        }
        MARGIN + Duration::from_secs_f64((2.0 * self.info.exposure_s[1] + self.info.readout_s).clamp(0.0, 1e6))
    }
}

/// Does nothing.
fn rest<'a>() -> Pending<'a, ()> {
    Box::pin(async { Ok(()) })
}

#[async_trait]
impl Camera for CameraHandle {
    fn describe(&self) -> CameraInfo {
        self.info.clone()
    }

    async fn configure(&mut self, exposure: Duration, gain: f64) -> DeviceResult<Controls> {
        let command = format!("set an exposure of {} s and a gain of {gain}", exposure.as_secs_f64());
        self.actor.call(&command, MARGIN, move |d| d.configure(exposure, gain)).await
    }

    async fn cover(&mut self, closed: bool) -> DeviceResult<Duration> {
        let command = if closed { "close the shutter" } else { "open the shutter" };
        self.actor.call(command, MARGIN, move |d| d.cover(closed)).await
    }

    async fn next_frame(&mut self, fresh: Freshness) -> DeviceResult<Frame> {
        // A camera at rest needs no clean-up.
        let limit = self.limit();
        self.actor.interruptible("take a frame", limit, move |d| d.next_frame(fresh), |_| rest()).await
    }
}

#[async_trait]
impl Display for DisplayHandle {
    fn describe(&self) -> DisplayInfo {
        self.info.clone()
    }

    async fn show(&mut self, pattern: Pattern) -> DeviceResult<Shown> {
        self.actor.call("show a pattern", MARGIN, move |d| d.show(pattern)).await
    }

    async fn dark(&mut self) -> DeviceResult<Shown> {
        self.actor.call("go dark", MARGIN, |d| d.dark()).await
    }

    async fn still_shows(&mut self) -> DeviceResult<()> {
        self.actor.call("say whether it still shows it", MARGIN, |d| d.still_shows()).await
    }
}

#[async_trait]
impl Flash for FlashHandle {
    fn describe(&self) -> FlashInfo {
        self.info.clone()
    }

    async fn switch(&mut self, on: bool) -> DeviceResult<Switched> {
        let command = if on { "switch on" } else { "switch off" };
        self.actor.call(command, MARGIN, move |d| d.switch(on)).await
    }

    async fn is_on(&mut self) -> DeviceResult<bool> {
        self.actor.call("report its state", MARGIN, |d| d.is_on()).await
    }
}

#[async_trait]
impl Interlock for InterlockHandle {
    fn describe(&self) -> InterlockInfo {
        self.info.clone()
    }

    async fn level(&mut self) -> DeviceResult<Level> {
        self.actor.call("report its level", MARGIN, |d| d.level()).await
    }
}
