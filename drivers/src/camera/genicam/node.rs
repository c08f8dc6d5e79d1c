//! Interface between the driver and a GenICam camera.

use std::time::Duration;

/// Result of a call on a camera.
pub type NodeResult<T> = Result<T, Failure>;

/// A call on a camera failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// Cause.
    pub cause: Cause,
    /// The library's message.
    pub text: String,
}

/// Cause of a failed call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The library cannot be loaded.
    Library,
    /// No camera of this name or address answers.
    Missing,
    /// Another program controls the camera.
    Held,
    /// The camera does not answer, or its link is broken.
    Gone,
    /// The camera lacks this feature or refuses this value.
    Unsupported,
    /// Any other cause.
    Other,
}

impl Failure {
    /// A failure with this cause.
    pub fn new(cause: Cause, text: impl Into<String>) -> Self {
        Self { cause, text: text.into() }
    }
}

/// A GenICam camera, or a fake one in tests.
pub trait Node: Send {
    /// Manufacturer, model and serial number.
    fn identity(&mut self) -> NodeResult<Identity>;
    /// Names of the supported pixel formats.
    fn formats(&mut self) -> NodeResult<Vec<String>>;
    /// Sets the pixel format; returns the 32-bit value of the one in force.
    fn set_format(&mut self, name: &str) -> NodeResult<u32>;
    /// Sets left, top, width and height of the region on the sensor, by default the whole sensor; returns the region in
    /// force.
    fn set_region(&mut self, region: Option<[u32; 4]>) -> NodeResult<[u32; 4]>;
    /// Disables automatic functions; returns the names of those that remain active.
    fn all_manual(&mut self) -> NodeResult<Vec<String>>;
    /// Shortest and longest exposure in s; `None` without exposure control.
    fn exposures(&mut self) -> NodeResult<Option<[f64; 2]>>;
    /// Sets the exposure if given; returns the one in force.
    fn exposure(&mut self, set: Option<Duration>) -> NodeResult<Duration>;
    /// Range of the gain; `None` without gain control.
    fn gains(&mut self) -> NodeResult<Option<Gains>>;
    /// Sets the gain in the camera's unit if given; returns the one in force.
    fn gain(&mut self, set: Option<f64>) -> NodeResult<f64>;
    /// Sets the black level in the camera's unit; returns the one in force.
    fn set_black_level(&mut self, level: f64) -> NodeResult<f64>;
    /// Sets the frame rate in Hz if given; returns the one in force, or `None` if the camera does not report it.
    fn frame_rate(&mut self, set: Option<f64>) -> NodeResult<Option<f64>>;
    /// Chooses between a software trigger and free running.
    fn set_software_trigger(&mut self, on: bool) -> NodeResult<()>;
    /// Triggers one exposure.
    fn trigger(&mut self) -> NodeResult<()>;
    /// Sets the size of network packets in bytes, by default the largest that arrives; returns the one in force, or
    /// `None` for USB cameras.
    fn packet_size(&mut self, set: Option<u32>) -> NodeResult<Option<u32>>;
    /// Starts the stream with this many buffers.
    fn start(&mut self, buffers: u32) -> NodeResult<()>;
    /// Stops the stream.
    fn stop(&mut self);
    /// The oldest frame in the queue; `None` if none arrived within `timeout`.
    fn dequeue(&mut self, timeout: Duration) -> Option<Buffer<'_>>;
    /// Packets of the current stream.
    fn packets(&mut self) -> Packets;
    /// Whether the camera answers a command at present.
    fn answers(&mut self) -> bool;
}

/// Manufacturer, model and serial number of a camera.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Identity {
    /// Manufacturer.
    pub vendor: String,
    /// Model.
    pub model: String,
    /// Serial number; may be empty.
    pub serial: String,
}

impl Identity {
    /// Stable identity for people and journals.
    pub fn words(&self) -> String {
        let Self { vendor, model, serial } = self;
        let serial = if serial.is_empty() { String::new() } else { format!(" s/n {serial}") };
        format!("genicam {vendor} {model}{serial}")
    }
}

/// Range of a gain control.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gains {
    /// Lowest value.
    pub low: f64,
    /// Highest value.
    pub high: f64,
    /// Whether the camera states that the unit is dB.
    pub decibel: bool,
}

/// Packets of a stream.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Packets {
    /// Packets that arrived.
    pub received: u64,
    /// Packets that were lost.
    pub missing: u64,
    /// Frames without a free buffer.
    pub underruns: u64,
}

/// Completeness of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// All packets arrived.
    Complete,
    /// Some packets are missing.
    MissingPackets,
    /// The end of the frame did not arrive in time.
    Timeout,
    /// A packet had a number that does not belong to the frame.
    WrongPacket,
    /// The frame is larger than announced.
    WrongSize,
    /// The stream ended within the frame.
    Aborted,
    /// The payload is not a picture.
    NoPicture,
}

/// A frame in the library's memory.
#[derive(Clone, Copy, Debug)]
pub struct Buffer<'a> {
    /// Payload sent by the camera.
    pub bytes: &'a [u8],
    /// Number of the frame on the wire; starts again after 65535 on GigE Vision.
    pub frame_id: u64,
    /// Arrival of the frame's first packet, on the monotonic clock.
    pub arrival: Duration,
    /// Timestamp on the camera's clock in ns; 0 for a camera without a clock.
    pub device_ns: u64,
    /// Completeness. Size and format are valid for complete frames only.
    pub status: Status,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Bytes between rows.
    pub padding: usize,
    /// 32-bit value of the pixel format.
    pub format: u32,
}
