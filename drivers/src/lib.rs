//! Device drivers of a bench: traits, errors, clock, and the rule for fresh frames.
//!
//! Each device family has a folder; the enumerations `StageDriver`, `CameraDriver`, `DisplayDriver`, `FlashDriver` and
//! `InterlockDriver` list the drivers. The simulated bench implements the same traits.

pub mod actor;
pub mod alpaca;
pub mod camera;
pub mod clock;
pub mod discovery;
pub mod display;
pub mod doctor;
pub mod error;
pub mod flash;
pub mod freshness;
pub mod handles;
pub mod hid;
pub mod indi;
pub mod interlock;
pub mod lock;
mod net;
pub mod socket_transport;
pub mod stage;
pub mod traits;
pub mod usb_reset;
pub mod wire;

pub use actor::{Connect, Patience};
pub use clock::{Clock, SystemClock};
pub use error::{Class, DeviceError, DeviceResult};
pub use freshness::{Freshness, Stamp};
pub use handles::{CameraHandle, DisplayHandle, FlashHandle, InterlockHandle, StageHandle};
pub use lock::DeviceLock;
pub use stage::{HandStage, Prompt};
pub use traits::{
    Arrived, Camera, CameraInfo, Controls, Display, DisplayInfo, EXPOSURE_TOLERANCE, Flash, FlashInfo, Frame,
    Interlock, InterlockInfo, Level, Pattern, Shown, Stage, StageInfo, Switched,
};
