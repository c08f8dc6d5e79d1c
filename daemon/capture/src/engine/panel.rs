//! Characterisation of a panel by the camera: tone curve, and latency between acknowledgement and visible pattern.
//!
//! The camera views any object lit by the panel: paper, a sample, or the panel itself. Luminances are means over the
//! pixels that see the panel, so that the object's reflectance cancels. The camera must be linear (`nacre init`
//! measures that).

use super::bench_controller::BenchController;
use super::meter;
use crate::failure::Failure;
use crate::plan::State;
use nacre_base::progress::Progress;
use nacre_drivers::display::kms::Tone;
use nacre_drivers::display::{PowerLaw, power_law};
use nacre_drivers::{DeviceError, Frame, Freshness, Pattern};
use serde::Serialize;
use std::f64::consts::TAU;
use std::time::Duration;

/// Numbers of levels whose codes are integers from 0 to 255.
pub const LEVELS: [usize; 5] = [6, 16, 18, 52, 86];

/// Number of frames averaged per level.
const AVERAGED: u32 = 3;

/// Number of observed transitions between black and white.
const CHANGES: u32 = 6;

/// Maximum number of frames observed after a transition, and number of consecutive frames that must show the new level.
const WATCHED: u32 = 60;
const SETTLED: u32 = 6;

/// Tolerance of the new level, relative to the transition, for a frame that shows the new pattern.
const THERE: f64 = 0.02;

/// Minimum signal of a pixel from the panel, relative to the brightest pixels.
const SEEN: f64 = 0.2;

/// Minimum number of such pixels.
const FEWEST: usize = 50;

/// Measured properties of a panel.
#[derive(Clone, Debug, Serialize)]
pub struct PanelFound {
    /// Luminances at evenly spaced codes from black to white, relative to white: means of an ascending and a descending
    /// series.
    pub luminances: Vec<f64>,
    /// Largest difference between both series relative to white, caused by drift of panel or camera.
    pub drift: f64,
    /// Fitted power law.
    pub law: PowerLaw,
    /// Number of pixels that see the panel.
    pub pixels: usize,
    /// Exposure time in ms.
    pub exposure_ms: f64,
    /// Number of observed transitions between black and white.
    pub changes: u32,
    /// Maximum number of frames after an acknowledgement that did not yet show the new pattern.
    pub late_frames: u32,
    /// Time from the acknowledgement to the end of the last such frame, in ms.
    pub late_ms: f64,
}

/// Pattern that makes a panel show the code `part` · 255 everywhere. A panel with a tone curve is asked for the
/// luminance at this code.
fn level(part: f64, tone: Option<&Tone>) -> Pattern {
    let luminance = tone.map_or(part, |tone| tone.luminance((255.0 * part).round() as u8));
    Pattern::Fringes {
        cycles_per_mm: [0.0; 2],
        phase: (2.0 * luminance - 1.0).clamp(-1.0, 1.0).acos() / TAU,
        gamma: 1.0,
    }
}

/// Measures the panel at this number of levels ([`LEVELS`]); `tone` is the tone curve that it already applies. After a
/// failure, the caller must switch the light off.
///
/// # Errors
/// Those of the devices; `Setup` if the camera sees too little of the panel, or if its signal does not grow with the
/// code.
pub async fn measure(
    controller: &mut BenchController<'_>,
    levels: usize,
    tone: Option<&Tone>,
    progress: &dyn Progress,
) -> Result<PanelFound, Failure> {
    controller.prepare(false).await?;
    controller.cover(false).await?;
    let white =
        State { pattern: level(1.0, tone), analyser_deg: None, flash: false, covered: false, exposure_ms: None };
    progress.stage("metering", 1);
    let camera = controller.limits().camera.clone();
    let exposure = meter::settled(meter::one(controller, 1.0, &white, None).await?, &camera);
    controller.expose(exposure, 1.0).await?;
    let panel_pixels = PanelPixels::open(controller, tone).await?;
    progress.stage("changes between black and white", u64::from(CHANGES));
    let (mut late_frames, mut late) = (0, Duration::ZERO);
    for change in 0..CHANGES {
        let (frames, time) = panel_pixels.late(controller, f64::from(change % 2), tone).await?;
        (late_frames, late) = (late_frames.max(frames), late.max(time));
        progress.step();
    }
    progress.stage("levels", 2 * levels as u64);
    let mut series = [vec![0.0; levels], vec![0.0; levels]];
    for k in 0..2 * levels {
        let at = if k < levels { k } else { 2 * levels - 1 - k };
        controller.show(level(at as f64 / (levels - 1) as f64, tone)).await?;
        series[k / levels][at] = panel_pixels.mean(controller, late_frames).await?;
        progress.step();
    }
    controller.dark().await?;
    let [rising, falling] = series;
    let luminances: Vec<f64> = rising.iter().zip(&falling).map(|(a, b)| 0.5 * (a + b)).collect();
    let law = power_law(&luminances).ok_or_else(|| {
        let expected = "luminances that grow with the code";
        let got = format!("{:.1} to {:.1} codes of the camera", luminances[0], luminances[levels - 1]);
        DeviceError::new(&camera.id, "measure the panel", expected, got)
            .remedy("keep other light away, and see that the panel lights what the camera sees")
    })?;
    let white = luminances[levels - 1];
    Ok(PanelFound {
        drift: rising.iter().zip(&falling).fold(0.0, |most: f64, (a, b)| most.max((a - b).abs())) / white,
        luminances: luminances.iter().map(|l| l / white).collect(),
        law,
        pixels: panel_pixels.pixels.len(),
        exposure_ms: 1e3 * exposure.as_secs_f64(),
        changes: CHANGES,
        late_frames,
        late_ms: 1e3 * late.as_secs_f64(),
    })
}

/// The pixels that see the panel.
struct PanelPixels {
    pixels: Vec<usize>,
    /// Camera code without light.
    black: f64,
    /// Mean codes above `black` for a black and a white panel.
    ends: [f64; 2],
}

impl PanelPixels {
    /// Selects the pixels.
    async fn open(controller: &mut BenchController<'_>, tone: Option<&Tone>) -> Result<Self, Failure> {
        let camera = controller.limits().camera.clone();
        let mut frames = vec![];
        for part in [0.0, 1.0] {
            controller.show(level(part, tone)).await?;
            frames.push(settled(controller).await?);
        }
        let [dark, lit] = [0, 1].map(|k| &frames[k].codes);
        let top = 0.97 * f64::from(camera.white);
        let seen = |i: usize| f64::from(lit[i]) - f64::from(dark[i]);
        let usable: Vec<usize> = (0..lit.len()).filter(|i| f64::from(lit[*i]) < top).collect();
        let brightest = usable.iter().map(|i| seen(*i)).fold(0.0, f64::max);
        let pixels: Vec<usize> =
            usable.into_iter().filter(|i| seen(*i) >= SEEN * brightest && seen(*i) > 0.0).collect();
        let panel_pixels = Self { pixels, black: f64::from(camera.black), ends: [0.0; 2] };
        let ends = [panel_pixels.of(&frames[0]), panel_pixels.of(&frames[1])];
        if panel_pixels.pixels.len() < FEWEST || ends[1] - ends[0] < 0.02 * f64::from(camera.white) {
            let got =
                format!("{} pixels, whose means are {:.1} and {:.1}", panel_pixels.pixels.len(), ends[0], ends[1]);
            let expected = format!("at least {FEWEST} pixels that see the panel");
            return Err(DeviceError::new(&camera.id, "measure the panel", expected, got)
                .remedy("put white paper where the sample is, keep other light away, then measure again")
                .into());
        }
        Ok(Self { ends, ..panel_pixels })
    }

    /// Mean code above black over the pixels.
    fn of(&self, frame: &Frame) -> f64 {
        let sum: u64 = self.pixels.iter().map(|i| u64::from(frame.codes[*i])).sum();
        sum as f64 / self.pixels.len().max(1) as f64 - self.black
    }

    /// Mean of several frames, after `late` frames that may show the previous pattern.
    async fn mean(&self, controller: &mut BenchController<'_>, late: u32) -> Result<f64, Failure> {
        for _ in 0..late {
            controller.fresh().await?;
        }
        let mut sum = 0.0;
        for _ in 0..AVERAGED {
            sum += self.of(&controller.fresh().await?.0);
        }
        Ok(sum / f64::from(AVERAGED))
    }

    /// Changes the pattern; returns the number of frames after the acknowledgement that do not show it, and the end of
    /// the last of them.
    async fn late(
        &self,
        controller: &mut BenchController<'_>,
        part: f64,
        tone: Option<&Tone>,
    ) -> Result<(u32, Duration), Failure> {
        let goal = self.ends[usize::from(part > 0.5)];
        let width = THERE * (self.ends[1] - self.ends[0]);
        controller.show(level(part, tone)).await?;
        let Freshness { steady_since, .. } = controller.freshness();
        let (mut late, mut until, mut since) = (0, Duration::ZERO, 0);
        for taken in 1..=WATCHED {
            let (frame, _) = controller.fresh().await?;
            if (self.of(&frame) - goal).abs() > width {
                (late, until, since) = (taken, frame.stamp.timestamp.saturating_sub(steady_since), 0);
            } else {
                since += 1;
            }
            if since == SETTLED {
                return Ok((late, until));
            }
        }
        let got = format!("another one in frame {late} after the change");
        Err(DeviceError::new(&controller.limits().display.id, "show black or white", "a steady level", got)
            .remedy("keep other light away and switch off what changes the panel's brightness by itself")
            .into())
    }
}

/// A frame long after the last change: the last of several, so that delayed ones are skipped.
async fn settled(controller: &mut BenchController<'_>) -> Result<Frame, Failure> {
    for _ in 0..WATCHED {
        controller.fresh().await?;
    }
    Ok(controller.fresh().await?.0)
}
