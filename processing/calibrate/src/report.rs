//! Report of a camera's calibration.

use crate::response::Response;
use crate::transfer::{Level, Measured, Transfer as PhotonTransfer};
use nacre_base::operation::{Summary, lines};
use nacre_frames::{NoiseModel, Transfer};
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::json;

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
    /// Photon transfer.
    #[serde(flatten)]
    pub transfer: PhotonTransfer,
    /// Response of a nonlinear camera; absent for a linear one. With it, all values in DN are corrected ones: they are
    /// proportional to light, with the camera's gain at low light.
    pub response: Option<Response>,
    /// Differences between pixels.
    pub spatial: Spatial,
    /// Noise as a `frames.json` states it, at gain 1.
    pub noise: NoiseModel,
    /// Exposures with light.
    pub lit: Vec<Level>,
    /// Exposures of darkness.
    pub dark: Vec<Level>,
    /// Computation time in seconds.
    pub seconds: f64,
}

impl Report {
    /// Keys of a `frames.json` for photographs of this camera.
    pub fn for_frames(&self, white: f64) -> String {
        let mut keys = json!({ "noise": self.noise, "black": self.transfer.black_dn, "white": white });
        if let Some(response) = &self.response {
            keys["transfer"] = json!(Transfer::Polynomial(response.coefficients));
        }
        format!("{keys:#}\n")
    }
}

impl Summary for Report {
    fn summary(&self) -> String {
        let with = |m: &Measured, unit: &str| format!("{:.4} ± {:.4} {unit}", m.value, m.sigma);
        let found = &self.transfer;
        let mut text = format!("gain      {}\n", with(&found.gain_dn_e, "DN/e⁻"));
        let mut add = |label: &str, value: String| text.push_str(&format!("{label:<10}{value}\n"));
        add("reading", with(&found.read_noise_e, "e⁻ of noise"));
        add("black", format!("{:.2} DN", found.black_dn));
        add("full well", found.full_well_e.map_or("not reached".into(), |e| format!("{e:.0} e⁻")));
        if let Some(current) = &found.dark_current_e_s {
            add("dark", with(current, "e⁻/s"));
        }
        if let Some(error) = found.linearity_error {
            let before = self
                .response
                .map_or(String::new(), |r| format!(" after correction, {:.2} % before", 100.0 * r.deviation));
            add("linear", format!("to {:.3} % on average{before}", 100.0 * error));
        }
        let s = &self.spatial;
        add("pixels", format!("DSNU {:.2} e⁻, PRNU {:.2} %, {} bad", s.dsnu_e, 100.0 * s.prnu, s.bad_pixels));
        text + lines(&[], &self.warnings).trim_end()
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }
}
