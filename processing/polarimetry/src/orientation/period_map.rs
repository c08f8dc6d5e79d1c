//! The optional period map of a reconstruction, and its report.

use crate::{OrientationMaps, PeriodMaps, PeriodScale, StokesMaps, polarization_of, relative_period};
use nacre_base::statistics::quantile;
use nacre_base::{Error, Result};
use nacre_optics::rcwa::{ALUMINIUM, Grating, ratio};
use num_complex::Complex;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Permitted range of periods in µm; longer ones would take minutes of rigorous diffraction.
const PERIODS_UM: [f64; 2] = [0.1, 20.0];
/// Largest assumed depth in µm.
const DEEPEST_UM: f64 = 2.0;
/// Error of R in the inverted table.
const TABLE_ERROR: f64 = 1e-3;
/// Relative error of the assumed depth whose effect is reported.
const DEPTH_OFF: f64 = 0.1;

/// Method of period estimation. `period.rs` describes the assumptions and limits of both.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "from", rename_all = "snake_case", deny_unknown_fields)]
pub enum PeriodMethod {
    /// **Heuristic**: from the mean intensity, as in the 2018 paper (section 5.4).
    Brightness {
        /// Periods in µm assigned to zero brightness and to the brightest pixel.
        range_um: [f64; 2],
    },
    /// From the degree of linear polarization by rigorous diffraction, for an assumed surface.
    Contrast {
        /// Range in µm that must contain all periods.
        range_um: [f64; 2],
        /// Assumed peak-to-peak depth of the grating in µm.
        depth_um: f64,
        /// Assumed metal.
        #[serde(default)]
        metal: Metal,
        /// Refractive index of the medium above the metal.
        #[serde(default = "air")]
        index_above: f64,
        /// Vacuum wavelength in nm; default: that of the photographs.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        wavelength_nm: Option<f64>,
    },
}

fn air() -> f64 {
    1.0
}

/// A metal by name, or by its complex refractive index as `N,K`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "String", into = "String")]
#[schemars(with = "String")]
pub struct Metal(Complex<f64>);

/// Refractive indices near 560 nm.
const METALS: [(&str, Complex<f64>); 4] = [
    ("aluminium", ALUMINIUM),
    ("silver", Complex::new(0.12, 3.45)),
    ("gold", Complex::new(0.33, 2.6)),
    ("chromium", Complex::new(2.7, 3.3)),
];

impl Metal {
    /// Complex refractive index with a positive imaginary part.
    pub fn index(self) -> Complex<f64> {
        self.0
    }
}

impl Default for Metal {
    fn default() -> Self {
        Self(ALUMINIUM)
    }
}

impl FromStr for Metal {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let named = METALS.iter().find(|(name, _)| *name == text).map(|(_, index)| *index);
        let given = || {
            let (n, k) = text.split_once(',')?;
            let index = Complex::new(n.trim().parse().ok()?, k.trim().parse().ok()?);
            ((0.0..=20.0).contains(&index.re) && (1e-3..=50.0).contains(&index.im)).then_some(index)
        };
        let problem =
            || format!("found {text:?}; give aluminium, silver, gold, chromium or an index N,K such as 1.0,6.5");
        named.or_else(given).map(Self).ok_or_else(problem)
    }
}

impl TryFrom<String> for Metal {
    type Error = String;

    fn try_from(text: String) -> std::result::Result<Self, String> {
        text.parse()
    }
}

impl From<Metal> for String {
    fn from(metal: Metal) -> Self {
        metal.to_string()
    }
}

impl fmt::Display for Metal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match METALS.iter().find(|(_, index)| *index == self.0) {
            Some((name, _)) => f.write_str(name),
            None => write!(f, "{},{}", self.0.re, self.0.im),
        }
    }
}

/// Report of the period map.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[schemars(rename = "PolarizationPeriodReport")]
pub struct PeriodReport {
    /// The requested method, with all its assumptions.
    pub method: PeriodMethod,
    /// Whether the periods are heuristic: only their order is meaningful.
    pub heuristic: bool,
    /// Ranges of period in µm that the polarization determines uniquely, under the assumptions; empty for heuristic
    /// periods.
    pub unique_um: Vec<[f64; 2]>,
    /// Pixels with a period.
    pub valid: usize,
    /// Pixels with an orientation but without a period, since no period or several in the range correspond to their
    /// polarization.
    pub ambiguous: usize,
    /// Median period in µm.
    pub median_um: Option<f64>,
    /// Median σ of the period in µm, due to noise.
    pub sigma_median_um: Option<f64>,
    /// Relative error of the median period if the true depth is 10 % smaller, and 10 % larger, than assumed; null where
    /// no period would be found.
    pub if_depth_is_off: Option<[Option<f64>; 2]>,
}

impl PeriodMethod {
    /// Label shown with every picture.
    pub(crate) fn label(&self) -> String {
        match self {
            Self::Brightness { .. } => "period (µm), heuristic".into(),
            Self::Contrast { depth_um, .. } => format!("period (µm) if {} nm deep", (1000.0 * depth_um).round()),
        }
    }

    fn range_um(&self) -> [f64; 2] {
        match self {
            Self::Brightness { range_um } | Self::Contrast { range_um, .. } => *range_um,
        }
    }

    /// Adds the wavelength of the photographs.
    ///
    /// # Errors
    /// For invalid numbers, and for a missing wavelength.
    pub(crate) fn completed(&self, photographs_nm: Option<f64>) -> Result<Self> {
        let ([low, high], [least, most]) = (self.range_um(), PERIODS_UM);
        let bad = |what: &str, found: String, wanted: &str| Error::input(what, found, wanted);
        let relative = matches!(self, Self::Brightness { .. });
        if !(low < high && high <= most && (low >= least || relative && low >= 0.0)) {
            let wanted = format!("give two rising numbers of µm, {least} to {most}");
            return Err(bad("range of periods", format!("found {low} to {high} µm"), &wanted));
        }
        let Self::Contrast { range_um, depth_um, metal, index_above, wavelength_nm } = self.clone() else {
            return Ok(self.clone());
        };
        if !(depth_um > 0.0 && depth_um <= DEEPEST_UM) {
            return Err(bad("depth", format!("found {depth_um} µm"), "give more than 0 and at most 2 µm"));
        }
        if !(1.0..=5.0).contains(&index_above) {
            return Err(bad("index above the metal", format!("found {index_above}"), "give 1 (air) to 5"));
        }
        let Some(nm) = wavelength_nm.or(photographs_nm) else {
            let wanted = "give --wavelength-nm, or \"wavelength_nm\" in frames.json";
            return Err(bad("wavelength", "the photographs do not say theirs".into(), wanted));
        };
        if !(100.0..=20_000.0).contains(&nm) {
            return Err(bad("wavelength", format!("found {nm} nm"), "give 100 to 20000 nm"));
        }
        Ok(Self::Contrast { range_um, depth_um, metal, index_above, wavelength_nm: Some(nm) })
    }

    /// Period of every pixel with an orientation, its report, and warnings. The method must be completed.
    pub(crate) fn period_maps(
        &self,
        maps: &StokesMaps,
        orientation: &OrientationMaps,
    ) -> Result<(PeriodMaps, PeriodReport, Vec<String>)> {
        match *self {
            Self::Brightness { range_um } => {
                let found = relative_period(maps, orientation, range_um)?;
                let warning = "periods are heuristic: they are read off the brightness, which Maxwell's equations do not \
                               support, and show any unevenness of light or reflectance as a period";
                let report = PeriodReport::new(self, &found, orientation);
                Ok((found, report, vec![warning.into()]))
            }
            Self::Contrast { range_um, depth_um, metal, index_above, wavelength_nm } => {
                let nm = wavelength_nm.unwrap_or_default();
                let surface = Grating { period_um: range_um[0], depth_um, above: index_above, below: metal.index() };
                let scale = PeriodScale::new(&surface, range_um, nm, TABLE_ERROR)?;
                let found = scale.invert(maps, orientation);
                let mut report = PeriodReport::new(self, &found, orientation);
                report.unique_um = scale.invertible().to_vec();
                report.if_depth_is_off = report.median_um.and_then(|p| if_depth_is_off(&scale, &surface, p, nm));
                let warnings = report.warnings(range_um);
                Ok((found, report, warnings))
            }
        }
    }
}

/// Relative error of a period found with the assumed depth if the true depth is 10 % smaller, and larger.
fn if_depth_is_off(scale: &PeriodScale, assumed: &Grating, period_um: f64, nm: f64) -> Option<[Option<f64>; 2]> {
    let error = |off: f64| {
        let truth = Grating { period_um, depth_um: assumed.depth_um * (1.0 + off), ..*assumed };
        let seen = polarization_of(ratio(&truth, nm, TABLE_ERROR).ok()?);
        Some(scale.period(seen)?.0 / period_um - 1.0)
    };
    Some([error(-DEPTH_OFF), error(DEPTH_OFF)])
}

impl PeriodReport {
    fn new(method: &PeriodMethod, found: &PeriodMaps, orientation: &OrientationMaps) -> Self {
        let median = |plane: &[f32]| {
            let mut known: Vec<f32> = plane.iter().copied().filter(|v| v.is_finite()).collect();
            quantile(&mut known, 0.5).map(f64::from)
        };
        let count = |plane: &[f32]| plane.iter().filter(|v| v.is_finite()).count();
        let valid = count(&found.period_um);
        Self {
            method: method.clone(),
            heuristic: matches!(method, PeriodMethod::Brightness { .. }),
            unique_um: vec![],
            valid,
            ambiguous: count(&orientation.orientation) - valid,
            median_um: median(&found.period_um),
            sigma_median_um: median(&found.sigma_um),
            if_depth_is_off: None,
        }
    }

    fn warnings(&self, [low, high]: [f64; 2]) -> Vec<String> {
        let PeriodMethod::Contrast { depth_um, metal, index_above, .. } = &self.method else { return vec![] };
        let percent = |e: Option<f64>| e.map_or("no period".into(), |e| format!("{:+.0} %", 100.0 * e));
        let mut warnings = vec![format!(
            "periods assume {metal} of {:.0} nm depth under an index of {index_above}; {}neither a film nor its front reflection is \
             in that model",
            1000.0 * depth_um,
            self.if_depth_is_off.map_or(String::new(), |[less, more]| format!(
                "if it is 10 % shallower or deeper they are off by {} or {}; ",
                percent(less),
                percent(more)
            ))
        )];
        let unique: f64 = self.unique_um.iter().map(|[a, b]| b - a).sum();
        if unique < 0.98 * (high - low) {
            let ranges: Vec<String> = self.unique_um.iter().map(|[a, b]| format!("{a:.2}-{b:.2}")).collect();
            let only = if ranges.is_empty() { "no period".into() } else { format!("only {} µm", ranges.join(", ")) };
            warnings.push(format!(
                "of {low} to {high} µm {only} can be told from the polarization, the rest is masked: narrow the range if you know more"
            ));
        }
        if self.ambiguous > self.valid {
            warnings.push(
                "most pixels have no period: their polarization answers to none or to several in the range, so the range, the depth \
                 or the metal may be wrong"
                    .into(),
            );
        }
        warnings
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metals_have_names_and_numbers() {
        for text in ["aluminium", "silver", "gold", "chromium", "1.5,4.25"] {
            assert_eq!(text.parse::<Metal>().unwrap().to_string(), text);
        }
        assert!(["", "iron", "1", "-1,3", "1,0", "1,nan"].iter().all(|t| t.parse::<Metal>().is_err()));
    }

    #[test]
    fn methods_are_read_and_checked() {
        let read = |text: &str| serde_json::from_str::<PeriodMethod>(text);
        let method = read(r#"{"from": "contrast", "range_um": [1.2, 3], "depth_um": 0.1, "metal": "gold"}"#).unwrap();
        assert!(method.completed(None).unwrap_err().to_string().contains("wavelength"));
        let PeriodMethod::Contrast { wavelength_nm, index_above, .. } = method.completed(Some(560.0)).unwrap() else {
            panic!("another method")
        };
        assert_eq!((wavelength_nm, index_above), (Some(560.0), 1.0));
        assert!(read(r#"{"from": "contrast", "range_um": [1.2, 3]}"#).is_err());
        assert!(read(r#"{"from": "brightness", "range_um": [1.2, 3], "depth_um": 1}"#).is_err());
        for bad in [
            r#"{"from": "brightness", "range_um": [2, 1]}"#,
            r#"{"from": "brightness", "range_um": [-1, 1]}"#,
            r#"{"from": "contrast", "range_um": [0, 1], "depth_um": 0.1}"#,
            r#"{"from": "contrast", "range_um": [1, 2], "depth_um": 0}"#,
            r#"{"from": "contrast", "range_um": [1, 2], "depth_um": 0.1, "index_above": 0.5}"#,
            r#"{"from": "contrast", "range_um": [1, 2], "depth_um": 0.1, "wavelength_nm": 1}"#,
        ] {
            assert!(read(bad).unwrap().completed(Some(560.0)).is_err(), "{bad}");
        }
    }
}
