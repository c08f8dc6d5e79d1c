//! Report of a camera's calibration.

use crate::transfer::{Level, Measured, Transfer};
use nacre_base::operation::{Summary, lines};
use nacre_frames::NoiseModel;
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::json;
use std::time::Instant;

/// Differences between pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Spatial {
    /// Standard deviation of the dark values in electrons, at the longest exposure (DSNU).
    pub dsnu_e: f64,
    /// Standard deviation of the response as a share, at half of the saturation (PRNU).
    pub prnu: f64,
    /// Number of pixels that differ far more.
    pub bad_pixels: usize,
}

/// Report of a camera.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[schemars(rename = "CameraReport")]
pub struct Report {
    /// Always `camera`.
    pub method: &'static str,
    /// Limitations of the result.
    pub warnings: Vec<String>,
    /// Gain K in DN per electron.
    pub gain_dn_e: Measured,
    /// Read noise in electrons.
    pub read_noise_e: Measured,
    /// Value without light and exposure in DN.
    pub black_dn: f64,
    /// Dark current in electrons per second; none for fewer than three dark exposures.
    pub dark_current_e_s: Option<Measured>,
    /// Electrons at saturation; none if no photograph is saturated.
    pub full_well_e: Option<f64>,
    /// Value at saturation, or the highest measured one, in DN.
    pub saturation_dn: f64,
    /// Mean deviation from proportionality to the exposure, as a share.
    pub linearity_error: Option<f64>,
    /// Chi-square per degree of freedom of the photon transfer.
    pub chi_square: f64,
    /// Number of exposures that the gain is fitted to.
    pub fitted: usize,
    /// Differences between pixels.
    pub spatial: Spatial,
    /// Noise as a `frames.json` states it.
    pub noise: NoiseModel,
    /// Exposures with light.
    pub lit: Vec<Level>,
    /// Exposures of darkness.
    pub dark: Vec<Level>,
    /// Computation time in seconds.
    pub seconds: f64,
}

impl Report {
    /// Collects the results.
    pub fn new(
        found: Transfer,
        spatial: Spatial,
        noise: NoiseModel,
        lit: Vec<Level>,
        dark: Vec<Level>,
        warnings: Vec<String>,
        begun: Instant,
    ) -> Self {
        Self {
            method: "camera",
            warnings,
            gain_dn_e: found.gain,
            read_noise_e: found.read_noise_e,
            black_dn: found.black_dn,
            dark_current_e_s: found.dark_current_e_s,
            full_well_e: found.full_well_e,
            saturation_dn: found.saturation_dn,
            linearity_error: found.linearity,
            chi_square: found.chi_square,
            fitted: found.fitted,
            spatial,
            noise,
            lit,
            dark,
            seconds: begun.elapsed().as_secs_f64(),
        }
    }

    /// Keys of a `frames.json` for photographs of this camera at this gain.
    pub fn for_frames(&self, white: f64) -> String {
        let keys = json!({ "noise": self.noise, "black": self.black_dn, "white": white });
        format!("{keys:#}\n")
    }
}

impl Summary for Report {
    fn summary(&self) -> String {
        let with = |m: &Measured, unit: &str| format!("{:.4} ± {:.4} {unit}", m.value, m.sigma);
        let mut text = format!("gain      {}\n", with(&self.gain_dn_e, "DN/e⁻"));
        let mut add = |label: &str, value: String| text.push_str(&format!("{label:<10}{value}\n"));
        add("reading", with(&self.read_noise_e, "e⁻ of noise"));
        add("black", format!("{:.2} DN", self.black_dn));
        add("full well", self.full_well_e.map_or("not reached".into(), |e| format!("{e:.0} e⁻")));
        if let Some(current) = &self.dark_current_e_s {
            add("dark", with(current, "e⁻/s"));
        }
        if let Some(error) = self.linearity_error {
            add("linear", format!("to {:.2} % on average", 100.0 * error));
        }
        let s = &self.spatial;
        add("pixels", format!("DSNU {:.2} e⁻, PRNU {:.2} %, {} bad", s.dsnu_e, 100.0 * s.prnu, s.bad_pixels));
        text + lines(&[], &self.warnings).trim_end()
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }
}
