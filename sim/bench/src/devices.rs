//! Simulated devices, which the capture engine uses like real ones. Their only access to the bench is a [`Port`], in
//! this process or behind a socket.

use crate::messages::{Devices, Reply, Request, error};
use crate::port::SharedBench;
use async_trait::async_trait;
use nacre_drivers::{
    Arrived, Camera, CameraInfo, Controls, DeviceError, DeviceResult, Display, DisplayInfo, Flash, FlashInfo, Frame,
    Freshness, Interlock, InterlockInfo, Level, Pattern, Shown, Stage, StageInfo, Switched,
};
use std::time::Duration;

/// Sends a request and extracts the expected kind of reply.
macro_rules! call {
    ($device:expr, $request:expr, $reply:pat => $value:expr) => {{
        let request = $request;
        match $device.port.call(&request)? {
            $reply => Ok($value),
            other => Err(unexpected(&request, &other)),
        }
    }};
}
/// Connection to the bench.
pub trait Port: Send {
    /// Executes a request.
    ///
    /// # Errors
    /// Those of the bench; `Lost` when it cannot be reached.
    fn call(&mut self, request: &Request) -> DeviceResult<Reply>;
}

impl Port for SharedBench {
    fn call(&mut self, request: &Request) -> DeviceResult<Reply> {
        self.answer(request)
    }
}

/// Any device of the bench; it implements the traits of all of them.
pub struct SimDevice {
    port: Box<dyn Port>,
    devices: Devices,
}

impl SimDevice {
    /// Connects a device to a port.
    ///
    /// # Errors
    /// The bench cannot be reached.
    pub fn new(mut port: Box<dyn Port>) -> DeviceResult<Self> {
        let request = Request::Describe;
        match port.call(&request)? {
            Reply::Described(devices) => Ok(Self { port, devices: *devices }),
            other => Err(unexpected(&request, &other)),
        }
    }

    /// Properties of all devices of the bench.
    pub fn devices(&self) -> &Devices {
        &self.devices
    }

    /// Turns the stage and waits for its arrival. If the future is dropped, the stage keeps turning.
    async fn turn(&mut self, request: Request) -> DeviceResult<Arrived> {
        call!(self, request.clone(), Reply::Turning => ())?;
        // Errors while it moves are errors of the movement.
        let moving = |e: DeviceError| {
            let DeviceError { device, command, .. } = error(&request, "", "");
            DeviceError { device, command, ..e }
        };
        loop {
            match self.port.call(&Request::Arrive).map_err(moving)? {
                Reply::Arrived(arrived) => return Ok(arrived),
                Reply::Turning => tokio::task::yield_now().await,
                other => return Err(unexpected(&Request::Arrive, &other)),
            }
        }
    }
}

fn unexpected(request: &Request, reply: &Reply) -> DeviceError {
    let got: String = format!("{reply:?}").chars().take(60).collect();
    error(request, "the answer to this request", &got)
}

#[async_trait]
impl Stage for SimDevice {
    fn describe(&self) -> StageInfo {
        self.devices.stage.clone()
    }

    async fn home(&mut self) -> DeviceResult<Arrived> {
        self.turn(Request::Home).await
    }

    async fn move_to(&mut self, angle_deg: f64) -> DeviceResult<Arrived> {
        self.turn(Request::MoveTo { angle_deg }).await
    }

    async fn halt(&mut self) -> DeviceResult<()> {
        call!(self, Request::Halt, Reply::At(_) => ())
    }

    async fn position(&mut self) -> DeviceResult<f64> {
        call!(self, Request::Position, Reply::Angle(a) => a)
    }
}

#[async_trait]
impl Camera for SimDevice {
    fn describe(&self) -> CameraInfo {
        self.devices.camera.clone()
    }

    async fn configure(&mut self, exposure: Duration, gain: f64) -> DeviceResult<Controls> {
        call!(self, Request::Configure { exposure, gain }, Reply::Controls(c) => c)
    }

    async fn cover(&mut self, closed: bool) -> DeviceResult<Duration> {
        call!(self, Request::Cover { closed }, Reply::At(t) => t)
    }

    async fn next_frame(&mut self, fresh: Freshness) -> DeviceResult<Frame> {
        call!(self, Request::NextFrame { fresh }, Reply::Frame { stamp, width, height, damaged, codes } =>
            Frame { stamp, width, height, damaged, codes })
    }
}

#[async_trait]
impl Display for SimDevice {
    fn describe(&self) -> DisplayInfo {
        self.devices.display.clone()
    }

    async fn show(&mut self, pattern: Pattern) -> DeviceResult<Shown> {
        call!(self, Request::Show { pattern }, Reply::Shown(s) => s)
    }
}

#[async_trait]
impl Flash for SimDevice {
    fn describe(&self) -> FlashInfo {
        self.devices.flash.clone()
    }

    async fn switch(&mut self, on: bool) -> DeviceResult<Switched> {
        call!(self, Request::Switch { on }, Reply::Switched(s) => s)
    }

    async fn is_on(&mut self) -> DeviceResult<bool> {
        call!(self, Request::IsOn, Reply::On(on) => on)
    }
}

#[async_trait]
impl Interlock for SimDevice {
    fn describe(&self) -> InterlockInfo {
        self.devices.interlock.clone()
    }

    async fn level(&mut self) -> DeviceResult<Level> {
        call!(self, Request::Level, Reply::Level(l) => l)
    }
}
