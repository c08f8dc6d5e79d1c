//! Results of a merge, and warnings about them.

use super::coding::Coding;
use super::merge::Sums;
use super::output::Numbers;
use super::report::{FrameReport, Report, Seconds};
use super::sample::Agreement;
use crate::{Frame, LoadedFrames};
use nacre_image::registration::Alignment;

/// Relative uncertainty of a recovered response, and minimum fraction of its codes observed; beyond them a warning is
/// issued.
const CERTAIN: f64 = 0.02;
const SEEN: f64 = 0.9;

/// Relative exposure error above which a warning is issued, if it also exceeds five standard deviations.
const GAIN_OFF: f64 = 0.03;

/// All results of the merge.
pub(super) struct Outcome {
    pub coding: Coding,
    pub sums: Sums,
    pub response: String,
    pub response_sigma: Option<f64>,
    pub seen: Option<f64>,
    pub shifts: Option<Alignment>,
    pub agreement: Option<Agreement>,
    pub noise_given: bool,
    /// Calibration factor of the assumed camera's noise.
    pub noise_factor: Option<f64>,
    /// Warning about photographs that clip below white.
    pub clipping: Option<String>,
}

impl Outcome {
    pub(super) fn report(&self, frames: &LoadedFrames, channels: &[&'static str], numbers: Numbers) -> Report {
        let (set, info) = (&frames.set, frames.info);
        let gain = |k: usize| self.agreement.as_ref().and_then(|a| a.gains[k]);
        let frame = |(k, f): (usize, &Frame)| FrameReport {
            file: f.file.display().to_string(),
            exposure: 1.0 / f.scale(),
            gain: gain(k),
        };
        let mut report = Report {
            method: "hdr",
            warnings: vec![],
            width: info.width,
            height: info.height,
            channels: channels.to_vec(),
            frames: set.frames.iter().enumerate().map(frame).collect(),
            response: self.response.clone(),
            response_sigma: self.response_sigma,
            dynamic_range: numbers.range,
            samples: numbers.samples,
            error_estimate: numbers.sigma,
            chi2: self.agreement.as_ref().and_then(|a| a.chi2),
            noise: match (self.noise_given, self.noise_factor) {
                (true, _) => "given",
                (false, Some(_)) => "estimated",
                (false, None) => "assumed",
            },
            noise_factor: self.noise_factor,
            registration: self.shifts.clone(),
            seconds: Seconds::default(),
        };
        report.warnings = frames.warnings.iter().chain(&self.clipping).cloned().collect();
        report.warnings.extend(self.warnings(&report));
        report
    }

    fn warnings(&self, report: &Report) -> Vec<String> {
        let mut all = vec![];
        let share = |n: usize| 100.0 * n as f64 / report.samples.all.max(1) as f64;
        if report.samples.saturated > 0 {
            let (n, share) = (report.samples.saturated, share(report.samples.saturated));
            let text = format!("{n} samples ({share:.2} %) are saturated in every exposure and unknown");
            all.push(format!("{text}; add a shorter exposure"));
        }
        if share(report.samples.dark) > 1.0 {
            let share = share(report.samples.dark);
            all.push(format!("{share:.1} % of the samples are dark in every exposure; add a longer exposure"));
        }
        if let Some(sigma) = self.response_sigma.filter(|s| *s > CERTAIN) {
            all.push(format!("the response is only known to {:.1} %; more exposures tell it better", 100.0 * sigma));
        }
        if let Some(seen) = self.seen.filter(|s| *s < SEEN) {
            let unseen = 100.0 * (1.0 - seen);
            all.push(format!("{unseen:.0} % of the response is a guess: no well exposed pixel has those values"));
        }
        for f in &report.frames {
            if let Some([gain, _]) = f.gain.filter(|[g, s]| (g - 1.0).abs() > GAIN_OFF.max(5.0 * s)) {
                let (off, word) = (100.0 * (gain - 1.0).abs(), if gain > 1.0 { "brighter" } else { "darker" });
                all.push(format!(
                    "{} is {off:.1} % {word} than its exposure time says: the time is rounded, the light changed, or the \
                     response is another",
                    f.file
                ));
            }
        }
        let most = if self.noise_given { 2.0 } else { 20.0 };
        if let Some(chi2) = report.chi2.filter(|c| *c > most) {
            all.push(format!(
                "the exposures differ by {:.1} times what noise explains: something moved, the light changed, or the response \
                 is another",
                chi2.sqrt()
            ));
        }
        if let Some(doubt) = report.registration.as_ref().and_then(|r| r.doubt.as_ref()) {
            all.push(format!("{doubt}; the exposures stay where they are"));
        }
        all
    }
}
