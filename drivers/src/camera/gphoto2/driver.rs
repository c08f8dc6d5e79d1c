//! The driver of cameras of libgphoto2, on any [`Node`].

use super::faults::{self, setup};
use super::node::{CameraFile, Node};
use super::open::{Choices, Opened, read, set};
use super::settings::{Format, Settings};
use crate::camera::photograph::{
    Photograph, PhotographReader, Shutter, choose_exposure, describe, is_same_step, speed,
};
use crate::camera::without_shutter;
use crate::{Camera, CameraInfo, Clock, Controls, DeviceError, DeviceResult, Frame, Freshness};
use async_trait::async_trait;
use std::sync::Arc;
use std::time::Duration;

/// Largest photograph in bytes; raw files of 150 megapixels have 300 MB.
const MAX_FILE: u64 = 512 << 20;

/// Exposure of the photograph that describes the camera, in s.
const FIRST_S: f64 = 0.01;

/// A camera of libgphoto2.
pub struct Gphoto2Camera {
    node: Box<dyn Node>,
    reader: Arc<dyn PhotographReader>,
    clock: Arc<dyn Clock>,
    settings: Settings,
    info: CameraInfo,
    speeds: Choices,
    sensitivities: Option<Choices>,
    internal: bool,
    shutter: Shutter,
    /// Names and labels of the controls in force.
    in_force: Vec<(&'static str, String)>,
}

impl Gphoto2Camera {
    /// Prepares a camera and takes one photograph, whose size and levels describe the camera.
    ///
    /// # Errors
    /// `Setup` if the camera is not usable as configured; `Lost` if it is gone; `Stop` for a low battery or a bad card.
    pub fn open(
        mut node: Box<dyn Node>,
        settings: Settings,
        clock: Arc<dyn Clock>,
        reader: Arc<dyn PhotographReader>,
    ) -> DeviceResult<Self> {
        let Opened { id, speeds, sensitivities, internal, warnings } = Opened::new(node.as_mut(), &settings)?;
        let first = speeds.nearest(FIRST_S).map(|(label, _)| label.clone()).unwrap_or_default();
        set(node.as_mut(), &id, speeds.name, &first)?;
        if let Some(lowest) = sensitivities.as_ref().and_then(|s| s.values.first().map(|(label, _)| (s.name, label))) {
            set(node.as_mut(), &id, lowest.0, lowest.1)?;
        }
        let sample = photograph(node.as_mut(), reader.as_ref(), &id, &settings, internal)?;
        if sample.shot.raw != (settings.format == Format::Raw) {
            let words = |raw: bool| if raw { "raw files" } else { "JPEG files" };
            return Err(setup(&id, words(settings.format == Format::Raw), words(sample.shot.raw))
                .remedy("set the camera's image quality, or `format` in the configuration"));
        }
        let exposures = speeds.values.iter().map(|(_, seconds)| *seconds).collect();
        let gains = sensitivities.as_ref().map_or([1.0, 1.0], |s| [1.0, gain(s, s.values.last())]);
        let mut info = describe(id, &sample, exposures, gains);
        info.warnings.extend(warnings);
        info.exposure_now_s = speeds.nearest(FIRST_S).map_or(FIRST_S, |(_, seconds)| *seconds);
        let shutter = Shutter::new(clock.clone(), Duration::from_secs_f64(info.exposure_now_s));
        let in_force = vec![(speeds.name, first)];
        Ok(Self { node, reader, clock, settings, info, speeds, sensitivities, internal, shutter, in_force })
    }

    /// Sets the sensitivity of a gain; returns the gain in force.
    fn set_gain(&mut self, wanted: f64) -> DeviceResult<f64> {
        let Some(choices) = &self.sensitivities else { return Ok(1.0) };
        let lowest = choices.values.first().map_or(100.0, |(_, iso)| *iso);
        let Some((label, iso)) = choices.nearest(wanted * lowest).cloned() else { return Ok(1.0) };
        set(self.node.as_mut(), &self.info.id, choices.name, &label)?;
        self.in_force.push((choices.name, label));
        Ok(iso / lowest)
    }

    /// Checks that the controls are still in force: a person may turn the camera's dials.
    fn check_controls(&mut self) -> DeviceResult<()> {
        for (name, label) in &self.in_force {
            let value = read(self.node.as_mut(), &self.info.id, name)?;
            if value != *label {
                return Err(DeviceError::new(&self.info.id, "take a photograph", format!("{name} {label}"), value)
                    .remedy("do not turn the camera's dials; resume the session"));
            }
        }
        Ok(())
    }

    /// Checks the exposure that the photograph states.
    fn check_exif(&self, photograph: &Photograph) -> DeviceResult<()> {
        let wanted = self.shutter.exposure.as_secs_f64();
        match photograph.shot.exposure_s {
            Some(stated) if !is_same_step(stated, wanted) => {
                let (expected, got) = (format!("an exposure of {}", speed(wanted)), speed(stated));
                Err(DeviceError::new(&self.info.id, "take a photograph", expected, got)
                    .remedy("turn the camera's mode dial to M, and check its custom functions"))
            }
            _ => Ok(()),
        }
    }
}

/// Gain of a sensitivity: its ratio to the lowest.
fn gain(choices: &Choices, choice: Option<&(String, f64)>) -> f64 {
    match (choice, choices.values.first()) {
        (Some((_, iso)), Some((_, lowest))) => iso / lowest,
        _ => 1.0,
    }
}

/// Takes a photograph, fetches and decodes it. In the camera's internal memory it is deleted.
fn photograph(
    node: &mut dyn Node,
    reader: &dyn PhotographReader,
    id: &str,
    settings: &Settings,
    internal: bool,
) -> DeviceResult<Photograph> {
    let taken = node.capture();
    let file: CameraFile = taken.map_err(|e| faults::command(id, "take a photograph", "a photograph", &e))?;
    let bytes = node.fetch(&file, MAX_FILE).map_err(|e| faults::command(id, "fetch a photograph", "a file", &e));
    if internal {
        // If this fails, the next photograph fails as well, and its error is reported.
        let _ = node.delete(&file);
    }
    reader.read_bytes(&file.name, &bytes?, settings.channel).map_err(|problem| {
        DeviceError::new(id, "read a photograph", "a photograph", format!("{}: {problem}", file.name))
            .remedy("choose another image quality on the camera, or another `format` in the configuration")
    })
}

#[async_trait]
impl Camera for Gphoto2Camera {
    fn describe(&self) -> CameraInfo {
        self.info.clone()
    }

    async fn configure(&mut self, exposure: Duration, gain: f64) -> DeviceResult<Controls> {
        let chosen = choose_exposure(&self.info, exposure)?;
        let Some((label, seconds)) = self.speeds.nearest(chosen).cloned() else {
            return Err(setup(&self.info.id, "shutter speeds", "none"));
        };
        set(self.node.as_mut(), &self.info.id, self.speeds.name, &label)?;
        self.in_force = vec![(self.speeds.name, label)];
        let gain = self.set_gain(gain)?;
        let exposure = Duration::from_secs_f64(seconds);
        Ok(Controls { exposure, gain, set_at: self.shutter.set(exposure) })
    }

    async fn cover(&mut self, closed: bool) -> DeviceResult<Duration> {
        without_shutter(&self.info.id, closed, self.clock.now())
    }

    async fn next_frame(&mut self, fresh: Freshness) -> DeviceResult<Frame> {
        if let Some(frame) = self.shutter.unexposed(&self.info, fresh) {
            return Ok(frame);
        }
        self.check_controls()?;
        let triggered = self.shutter.steady(&self.info, fresh)?;
        let (node, reader) = (self.node.as_mut(), self.reader.as_ref());
        let taken = photograph(node, reader, &self.info.id, &self.settings, self.internal)?;
        self.check_exif(&taken)?;
        self.shutter.photographed(&self.info, triggered, taken)
    }
}
