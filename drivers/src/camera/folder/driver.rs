//! The camera whose photographs appear in a folder.

use super::matching::CameraClock;
use super::settings::Settings;
use super::trigger::Release;
use super::watch::{Watch, newest};
use crate::camera::photograph::{
    Photograph, PhotographReader, Photography, Shot, Shutter, choose_exposure, describe, is_same_step, speed,
};
use crate::camera::without_shutter;
use crate::{Camera, CameraInfo, Class, Clock, Controls, DeviceError, DeviceResult, Frame, Freshness};
use async_trait::async_trait;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};

/// Interval at which the folder is read.
const POLL: Duration = Duration::from_millis(100);
/// Number of files that are tried as the photograph that describes the camera.
const SAMPLES: usize = 8;
/// Highest gain relative to the configured sensitivity.
const MAX_GAIN: f64 = 1024.0;
/// Maximum number of skipped files in a message.
const MAX_NAMED: usize = 4;
/// Longest file name in a message, in characters.
const MAX_NAME: usize = 60;

/// A camera whose photographs appear in a folder.
pub struct FolderCamera {
    settings: Settings,
    reader: Arc<dyn PhotographReader>,
    clock: Arc<dyn Clock>,
    info: CameraInfo,
    sample: Shot,
    release: Release,
    watch: Watch,
    shutter: Shutter,
    camera_clock: CameraClock,
    /// Exposure in s and sensitivity that the next photograph must have.
    wanted: (f64, f64),
    /// Those of the last photograph.
    dials: (Option<f64>, Option<f64>),
}

/// Opens a folder. The newest photograph in it describes the camera.
///
/// # Errors
/// `Setup` without a photograph, or if the shutter's output cannot be opened.
pub fn open(settings: &Settings, clock: &Arc<dyn Clock>, program: &Photography) -> DeviceResult<Box<dyn Camera>> {
    Ok(Box::new(FolderCamera::open(settings, clock, program)?))
}

impl FolderCamera {
    fn open(settings: &Settings, clock: &Arc<dyn Clock>, program: &Photography) -> DeviceResult<Self> {
        settings.check().map_err(|wrong| {
            setup(&settings.path, "settings of a folder", wrong)
                .remedy("correct the camera's settings in the configuration")
        })?;
        let folder = Path::new(&settings.path);
        let sample = sample(settings, program.reader.as_ref())?;
        let id = identity(&sample.shot);
        let mut info = describe(id, &sample, settings.exposures(), [1.0, MAX_GAIN]);
        info.by_hand = true;
        let release = Release::open(settings, clock, (program.prompt)())?;
        let mut camera_clock = CameraClock::default();
        camera_clock.earlier(sample.shot.taken);
        let shutter = Shutter::new(clock.clone(), Duration::from_secs_f64(info.exposure_now_s));
        Ok(Self {
            wanted: (info.exposure_now_s, settings.iso),
            dials: (sample.shot.exposure_s, sample.shot.iso),
            reader: program.reader.clone(),
            clock: clock.clone(),
            watch: Watch::new(folder),
            sample: sample.shot,
            settings: settings.clone(),
            info,
            release,
            shutter,
            camera_clock,
        })
    }

    /// Settings to change on the camera before the next photograph, if any.
    fn change(&self) -> Option<String> {
        let (exposure, iso) = self.wanted;
        let set = self.dials.0.is_some_and(|is| is_same_step(is, exposure))
            && self.dials.1.is_none_or(|is| is_same_step(is, iso));
        (!set).then(|| format!("{} and ISO {}", speed(exposure), iso.round()))
    }

    fn unreadable(&self, e: &io::Error) -> DeviceError {
        DeviceError::new(&self.info.id, "watch the folder", self.settings.path.as_str(), e.to_string())
            .remedy("check `path` in the configuration, the folder's rights, and that it is not overfull")
    }

    /// Waits for a complete photograph that was taken after `since`, in s of the computer's clock.
    async fn wait(&mut self, since: f64) -> DeviceResult<Photograph> {
        let begun = self.clock.now();
        let limit = Duration::from_secs_f64(self.wanted.0 + self.settings.wait_s);
        let mut skipped: Vec<(PathBuf, String)> = vec![];
        loop {
            let now = self.clock.now();
            let ready = self.watch.complete(now).map_err(|e| self.unreadable(&e))?;
            for file in ready {
                match self.examine(&file, since)? {
                    Ok(photograph) => return Ok(photograph),
                    Err(reason) => {
                        skipped.retain(|(path, _)| *path != file);
                        skipped.push((file, reason));
                    }
                }
            }
            if self.clock.now().saturating_sub(begun) > limit {
                return Err(self.none(limit, &skipped));
            }
            tokio::time::sleep(POLL).await;
        }
    }

    fn none(&self, limit: Duration, skipped: &[(PathBuf, String)]) -> DeviceError {
        let expected = format!("a photograph in {} within {:.0} s", self.settings.path, limit.as_secs_f64());
        let files: Vec<String> =
            skipped.iter().rev().take(MAX_NAMED).map(|(path, reason)| format!("{}: {reason}", name(path))).collect();
        let got = if files.is_empty() { "none".to_owned() } else { format!("only {}", files.join("; ")) };
        DeviceError::new(&self.info.id, "take a photograph", expected, got).remedy(
            "check the camera, the program that fetches its photographs, and `path`; `wait_s` allows slower transfers",
        )
    }

    /// Reads a new file; the inner error is the reason for skipping it.
    fn examine(&mut self, file: &Path, since: f64) -> DeviceResult<Result<Photograph, String>> {
        match self.reader.kind(&name(file)) {
            None => {
                self.watch.done(file);
                return Ok(Err("no photograph".into()));
            }
            Some(raw) if raw != self.sample.raw => {
                self.watch.done(file);
                let words = if self.sample.raw { "not a raw file" } else { "not a JPEG file" };
                return Ok(Err(words.into()));
            }
            Some(_) => {}
        }
        let shot = match self.reader.shot(file) {
            Ok(shot) => shot,
            Err(problem) => return Ok(Err(problem)),
        };
        if self.camera_clock.is_older(shot.taken, since) {
            self.watch.done(file);
            return Ok(Err("taken before the request, by its Exif time".into()));
        }
        // An incomplete file may lack its tags, so it is decoded before they are compared.
        let photograph = match self.reader.read(file, self.settings.channel) {
            Ok(photograph) => photograph,
            Err(problem) => return Ok(Err(problem)),
        };
        self.watch.done(file);
        let shot = photograph.shot.clone();
        self.check_camera(file, &shot)?;
        self.check_dials(file, &shot)?;
        self.camera_clock.learn(shot.taken, since, unix_now());
        Ok(Ok(photograph))
    }

    fn check_camera(&self, file: &Path, shot: &Shot) -> DeviceResult<()> {
        if (&shot.model, &shot.serial) == (&self.sample.model, &self.sample.serial) {
            return Ok(());
        }
        let got = format!("{} in {}", identity(shot), name(file));
        Err(DeviceError::new(&self.info.id, "take a photograph", self.info.id.as_str(), got)
            .remedy("take all photographs with one camera, then resume the session"))
    }

    /// Compares the photograph's exposure and sensitivity with the wanted ones.
    fn check_dials(&mut self, file: &Path, shot: &Shot) -> DeviceResult<()> {
        self.dials = (shot.exposure_s, shot.iso);
        let (exposure, iso) = self.wanted;
        let wrong = |expected: String, got: String| {
            let remedy =
                format!("set the camera to {} and ISO {}, then resume the session", speed(exposure), iso.round());
            Err(DeviceError::new(&self.info.id, "take a photograph", expected, format!("{got} in {}", name(file)))
                .remedy(remedy))
        };
        match shot.exposure_s {
            None => return wrong(format!("an exposure of {}", speed(exposure)), "no exposure in the Exif tags".into()),
            Some(is) if !is_same_step(is, exposure) => {
                return wrong(format!("an exposure of {}", speed(exposure)), speed(is));
            }
            Some(_) => {}
        }
        match shot.iso {
            Some(is) if !is_same_step(is, iso) => wrong(format!("ISO {}", iso.round()), format!("ISO {}", is.round())),
            _ => Ok(()),
        }
    }
}

fn identity(shot: &Shot) -> String {
    let model = shot.model.as_deref().unwrap_or("an unknown camera");
    match &shot.serial {
        Some(serial) => format!("photographs of {model} s/n {serial}"),
        None => format!("photographs of {model}"),
    }
}

fn name(file: &Path) -> String {
    let name = file.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    name.chars().map(|c| if c.is_control() { '?' } else { c }).take(MAX_NAME).collect()
}

fn unix_now() -> f64 {
    SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0.0, |d| d.as_secs_f64())
}

fn setup(path: &str, expected: impl Into<Box<str>>, got: impl Into<Box<str>>) -> DeviceError {
    DeviceError::new(&format!("folder {path}"), "open", expected, got).class(Class::Setup)
}

/// The newest photograph of the folder; of a pair of a raw and a JPEG file, the raw one.
fn sample(settings: &Settings, reader: &dyn PhotographReader) -> DeviceResult<Photograph> {
    let folder = Path::new(&settings.path);
    let remedy = "put one photograph of the camera, as it will be used, into the folder";
    let files = newest(folder, |name| reader.kind(name).is_some());
    let files = files.map_err(|e| setup(&settings.path, "a folder", e.to_string()).remedy("correct `path`"))?;
    let is_raw = |file: &PathBuf| reader.kind(&name(file)) == Some(true);
    let has_raw = |file: &PathBuf| files.iter().any(|f| is_raw(f) && f.file_stem() == file.file_stem());
    let mut problem = "none".to_owned();
    for file in files.iter().filter(|f| is_raw(f) || !has_raw(f)).take(SAMPLES) {
        match reader.read(file, settings.channel) {
            Ok(photograph) if photograph.shot.exposure_s.is_some() => return Ok(photograph),
            Ok(_) => problem = format!("{} without an exposure in its Exif tags", name(file)),
            Err(error) => problem = format!("{}: {error}", name(file)),
        }
    }
    Err(setup(&settings.path, "a photograph", problem).remedy(remedy))
}

#[async_trait]
impl Camera for FolderCamera {
    fn describe(&self) -> CameraInfo {
        self.info.clone()
    }

    async fn configure(&mut self, exposure: Duration, gain: f64) -> DeviceResult<Controls> {
        let seconds = choose_exposure(&self.info, exposure)?;
        self.wanted = (seconds, gain.clamp(1.0, MAX_GAIN) * self.settings.iso);
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
        self.shutter.steady(&self.info, fresh)?;
        self.watch.mark().map_err(|e| self.unreadable(&e))?;
        let since = unix_now();
        let change = self.change();
        self.release.request(&self.info.id, change).await?;
        let triggered = self.clock.now();
        let photograph = self.wait(since).await?;
        self.shutter.photographed(&self.info, triggered, photograph)
    }
}
