//! Devices of a bench: what they can be asked for, how they fail, their time, and the rule for fresh frames.
//!
//! Drivers of real devices come later; the simulated bench implements these traits today.

pub mod actor;
pub mod clock;
pub mod error;
pub mod freshness;
pub mod hand;
pub mod handles;
pub mod lock;
pub mod traits;

pub use actor::{Connect, Patience};
pub use clock::{Clock, SystemClock};
pub use error::{Class, DeviceError, DeviceResult};
pub use freshness::{Freshness, Stamp};
pub use hand::{HandStage, Prompt};
pub use handles::{CameraHandle, DisplayHandle, FlashHandle, InterlockHandle, StageHandle};
pub use lock::DeviceLock;
pub use traits::{
    Arrived, Camera, CameraInfo, Controls, Display, DisplayInfo, Flash, FlashInfo, Frame, Interlock, InterlockInfo,
    Level, Pattern, Shown, Stage, StageInfo, Switched,
};
