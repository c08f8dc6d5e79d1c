//! Free-running camera: its frame queue becomes stale, and settings take effect late.

use crate::config::CameraConfig;
use nacre_drivers::Stamp;
use std::collections::VecDeque;
use std::time::Duration;

/// Exposure and gain of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Exposure time in seconds.
    pub exposure_s: f64,
    /// Gain.
    pub gain: f64,
}

/// An exposed frame; its pixels are rendered when it is read.
#[derive(Clone, Copy, Debug)]
pub struct Exposed {
    /// Number of the frame since the start of the stream.
    pub sequence: u64,
    /// Start of the exposure.
    pub start: Duration,
    /// End of the readout, which a camera reports as timestamp.
    pub end: Duration,
    /// Settings of the exposure.
    pub settings: Settings,
    /// Start of the first frame with these settings.
    pub adopted: Duration,
}

impl Exposed {
    /// Metadata that the camera reports with the frame.
    pub fn stamp(&self) -> Stamp {
        Stamp { sequence: self.sequence, timestamp: self.end }
    }
}

/// Timing of a simulated camera.
pub struct Camera {
    readout: Duration,
    queue_length: usize,
    lag: u32,
    queue: VecDeque<Exposed>,
    /// Current settings, and pending ones with the number of frames until they take effect.
    settings: Settings,
    pending: Vec<(u32, Settings)>,
    adopted: Duration,
    next_start: Duration,
    sequence: u64,
}

impl Camera {
    /// A camera that starts to stream at time 0.
    pub fn new(config: &CameraConfig) -> Self {
        Self {
            readout: Duration::from_secs_f64(config.readout_ms / 1000.0),
            queue_length: config.queue as usize,
            lag: config.lag_frames,
            queue: VecDeque::new(),
            settings: Settings { exposure_s: config.power_on_exposure_s(), gain: config.gain },
            pending: Vec::new(),
            adopted: Duration::ZERO,
            next_start: Duration::ZERO,
            sequence: 0,
        }
    }

    /// Readout time.
    pub fn readout(&self) -> Duration {
        self.readout
    }

    /// Requests other settings; they apply to the first frame that starts after `lag_frames` more have started.
    pub fn set(&mut self, settings: Settings) {
        self.pending.push((self.lag, settings));
    }

    /// End of the current exposure's readout.
    pub fn next_end(&self) -> Duration {
        self.next_start + Duration::from_secs_f64(self.upcoming().exposure_s) + self.readout
    }

    /// Exposes all frames that end by `now`. A full queue drops new frames and keeps old ones, as V4L2 does.
    pub fn advance(&mut self, now: Duration) {
        while self.next_end() <= now {
            let settings = self.upcoming();
            if settings != self.settings {
                (self.settings, self.adopted) = (settings, self.next_start);
            }
            self.pending.retain(|(left, _)| *left > 0);
            self.pending.iter_mut().for_each(|(left, _)| *left -= 1);
            let end = self.next_start + Duration::from_secs_f64(self.settings.exposure_s) + self.readout;
            let (sequence, start) = (self.sequence, self.next_start);
            let frame = Exposed { sequence, start, end, settings: self.settings, adopted: self.adopted };
            if self.queue.len() < self.queue_length {
                self.queue.push_back(frame);
            }
            self.sequence += 1;
            self.next_start = end;
        }
    }

    /// Takes the oldest frame from the queue.
    pub fn take(&mut self) -> Option<Exposed> {
        self.queue.pop_front()
    }

    fn upcoming(&self) -> Settings {
        self.pending.iter().rev().find(|(left, _)| *left == 0).map_or(self.settings, |(_, s)| *s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_queue_keeps_stale_frames_and_settings_lag() {
        let config = CameraConfig {
            exposure_ms: Some(40.0),
            readout_ms: 10.0,
            queue: 4,
            lag_frames: 2,
            ..CameraConfig::default()
        };
        let mut camera = Camera::new(&config);
        camera.advance(Duration::from_secs(1));
        let taken: Vec<u64> = std::iter::from_fn(|| camera.take()).map(|f| f.sequence).collect();
        assert_eq!(taken, [0, 1, 2, 3], "the first four frames, a second old");
        camera.set(Settings { exposure_s: 0.02, gain: 1.0 });
        camera.advance(Duration::from_secs(2));
        let exposures: Vec<f64> = std::iter::from_fn(|| camera.take()).map(|f| f.settings.exposure_s).collect();
        assert_eq!(exposures, [0.04, 0.04, 0.02, 0.02]);
    }
}
