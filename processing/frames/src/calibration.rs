//! Calibrations of a bench, as `calibration.json` states them and sessions record them in `frames.json`.

use super::{NoiseModel, Transfer};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Name of the file that `nacre calibrate` writes beside its report.
pub const CALIBRATION_FILE: &str = "calibration.json";

/// Calibrated properties of a bench. Reconstructions apply the analyser, retarder and orientation of a `frames.json`;
/// camera and flat field are stated there by `noise`, `black`, `white` and `flat`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Noise and levels of the camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraCalibration>,
    /// Unevenness of light and lens.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flat: Option<FlatCalibration>,
    /// Zero, sense and extinction of the analyser.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub analyser: Option<AnalyserCalibration>,
    /// Polarization behind the retarder of the panel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub retarder: Option<RetarderCalibration>,
    /// Offset of orientations, from a sample of known orientation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub orientation: Option<OrientationCalibration>,
}

/// Origin of a calibration in the data folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CalibrationSource {
    /// Identifier of the calibration.
    pub id: String,
    /// Time of its photographs in Unix seconds.
    pub taken: u64,
    /// Identities of the calibrated devices.
    pub devices: Vec<String>,
}

/// Noise and levels of a camera (`nacre calibrate camera`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraCalibration {
    /// Origin, for calibrations of a data folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<CalibrationSource>,
    /// Noise at gain 1.
    pub noise: NoiseModel,
    /// File value without light.
    pub black: f64,
    /// File value of a saturated pixel.
    pub white: f64,
    /// Gain of the photographs relative to the camera's base.
    pub gain: f64,
    /// Coefficients of the `transfer` polynomial; absent for a linear camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub response: Option<[f64; 3]>,
}

/// Unevenness of light and lens (`nacre calibrate flat`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FlatCalibration {
    /// Origin, for calibrations of a data folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<CalibrationSource>,
    /// Flat field, relative to the folder of this description.
    pub file: PathBuf,
    /// Standard deviation of a typical pixel of the flat field, as a share of its value.
    pub sigma: f64,
}

/// Analyser and its stage (`nacre calibrate analyser`): at the stage's angle ψ, the transmission axis is at
/// `zero + sense · (ψ + c cos ψ + s sin ψ)`, anticlockwise from the right of the image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AnalyserCalibration {
    /// Origin, for calibrations of a data folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<CalibrationSource>,
    /// Transmission axis at the stage's zero, in degrees.
    pub zero_deg: f64,
    /// Standard deviation of the zero in degrees.
    pub zero_sigma_deg: f64,
    /// Sense of rotation as seen by the camera: 1 for anticlockwise, -1 for clockwise.
    pub sense: i8,
    /// Eccentricity of the stage's scale: the coefficients c and s in degrees.
    #[serde(default)]
    pub eccentricity_deg: [f64; 2],
    /// Transmission through parallel over crossed polarizers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub extinction_ratio: Option<f64>,
}

/// Polarization of the panel behind its retarder (`nacre calibrate retarder`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RetarderCalibration {
    /// Origin, for calibrations of a data folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<CalibrationSource>,
    /// Direction of the panel's linear polarization in degrees.
    pub panel_deg: f64,
    /// Direction of the retarder's axis in degrees.
    pub azimuth_deg: f64,
    /// Standard deviation of the azimuth in degrees.
    pub azimuth_sigma_deg: f64,
    /// Retardance in degrees at the wavelength of the photographs.
    pub retardance_deg: f64,
    /// Standard deviation of the retardance in degrees.
    pub retardance_sigma_deg: f64,
}

/// Offset of orientations, from a sample of known orientation (`nacre calibrate orientation`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OrientationCalibration {
    /// Origin, for calibrations of a data folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<CalibrationSource>,
    /// Offset in degrees to add to orientations.
    pub offset_deg: f64,
    /// Standard deviation of the offset in degrees.
    pub sigma_deg: f64,
    /// Grating model of the measurement; the offset of another model differs.
    pub model: String,
}

impl AnalyserCalibration {
    /// Transmission axis in degrees at an angle of the stage in degrees.
    pub fn axis_deg(&self, stage_deg: f64) -> f64 {
        let (sin, cos) = stage_deg.to_radians().sin_cos();
        let [c, s] = self.eccentricity_deg;
        self.zero_deg + f64::from(self.sense) * (stage_deg + c * cos + s * sin)
    }

    /// Contrast behind parallel and crossed polarizers, (E - 1)/(E + 1) for the extinction ratio E; 1 if unknown.
    pub fn contrast(&self) -> f64 {
        self.extinction_ratio.map_or(1.0, |ratio| (ratio - 1.0) / (ratio + 1.0))
    }

    /// Key and problem of an invalid number.
    fn problem(&self) -> Option<(&'static str, String)> {
        let angles = [self.zero_deg, self.zero_sigma_deg, self.eccentricity_deg[0], self.eccentricity_deg[1]];
        if let Some(angle) = angles.into_iter().find(|a| !a.is_finite() || a.abs() > 1e6) {
            return Some(("calibration.analyser", format!("{angle} is no angle in degrees")));
        }
        if self.sense.abs() != 1 {
            return Some(("calibration.analyser.sense", format!("{} is neither 1 nor -1", self.sense)));
        }
        let ratio = self.extinction_ratio.filter(|ratio| ratio.is_nan() || *ratio < 1.5)?;
        Some(("calibration.analyser.extinction_ratio", format!("{ratio} is not above 1.5")))
    }
}

impl Calibration {
    /// Key and problem of an invalid number that reconstructions would apply.
    pub fn problem(&self) -> Option<(&'static str, String)> {
        let angle = |key: &'static str, values: &[f64]| {
            let bad = values.iter().find(|a| !a.is_finite() || a.abs() > 1e6)?;
            Some((key, format!("{bad} is no angle in degrees")))
        };
        let retarder = self.retarder.as_ref().and_then(|r| {
            let sigmas = [r.azimuth_sigma_deg, r.retardance_sigma_deg];
            angle(
                "calibration.retarder",
                &[[r.panel_deg, r.azimuth_deg, r.retardance_deg].as_slice(), &sigmas].concat(),
            )
        });
        let orientation =
            self.orientation.as_ref().and_then(|o| angle("calibration.orientation", &[o.offset_deg, o.sigma_deg]));
        let response = self.camera.as_ref().and_then(|c| Transfer::Polynomial(c.response?).problem());
        let response = response.map(|(_, problem)| ("calibration.camera.response", problem));
        self.analyser.as_ref().and_then(AnalyserCalibration::problem).or(retarder).or(orientation).or(response)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_axis_follows_zero_sense_and_eccentricity() {
        let analyser = AnalyserCalibration {
            source: None,
            zero_deg: 10.0,
            zero_sigma_deg: 0.0,
            sense: -1,
            eccentricity_deg: [0.5, 0.25],
            extinction_ratio: Some(99.0),
        };
        assert!((analyser.axis_deg(0.0) - 9.5).abs() < 1e-12);
        assert!((analyser.axis_deg(90.0) + 80.25).abs() < 1e-12);
        assert!((analyser.contrast() - 0.98).abs() < 1e-12);
    }
}
