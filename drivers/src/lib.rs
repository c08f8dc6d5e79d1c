//! Devices of a bench: what they can be asked for, how they fail, their time, and the rule for fresh frames.
//!
//! Drivers of real devices come later; the simulated bench implements these traits today.

pub mod clock;
pub mod error;
pub mod freshness;
pub mod traits;

pub use clock::{Clock, SystemClock};
pub use error::{Class, DeviceError, DeviceResult};
pub use freshness::{Freshness, Stamp};
pub use traits::{Camera, CameraInfo, Controls, Display, DisplayInfo, Frame, Pattern, Settled, Stage, StageInfo};
