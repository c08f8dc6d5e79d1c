//! State and end of an adaptive series, which continues until a required uncertainty is reached.

use serde::{Deserialize, Serialize};

/// Present accuracy of orientations in a series.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SigmaSoFar {
    /// Number of analyser angles.
    pub angles: usize,
    /// 90th percentile of σ in degrees over the pixels with an orientation; `None` if no pixel has one.
    pub sigma_deg: Option<f64>,
    /// Required σ in degrees.
    pub until_sigma_deg: f64,
    /// Maximum number of angles.
    pub at_most: u32,
    /// Predicted lower bound of σ in degrees after the maximum number of angles; `None` if no pixel will have an
    /// orientation.
    pub least_deg: Option<f64>,
}

/// Present state of a fringe series.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FringesSoFar {
    /// Number of fringes.
    pub fringes: u32,
    /// Fraction of the pixels with a first order on the panel that are ambiguous between gratings, or whose period is
    /// less accurate than required; `None` if no pixel has one.
    pub undecided: Option<f64>,
    /// Permitted fraction.
    pub until_undecided: f64,
    /// Maximum number of fringes.
    pub at_most: u32,
}

/// Present state of an adaptive series.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum SoFar {
    /// Orientations from analyser angles.
    Sigma(SigmaSoFar),
    /// Fringes on the panel.
    Fringes(FringesSoFar),
}

impl SoFar {
    /// Short text for a progress bar.
    pub fn label(&self) -> String {
        match self {
            Self::Sigma(s) => {
                let now = s.sigma_deg.map_or("none".to_owned(), |s| format!("{s:.2}°"));
                format!("capturing: σ {now}, {}° wanted", s.until_sigma_deg)
            }
            Self::Fringes(f) => {
                let now = f.undecided.map_or("no order".to_owned(), |u| format!("{:.1} % undecided", 100.0 * u));
                format!("capturing: {now}, {} % wanted", 100.0 * f.until_undecided)
            }
        }
    }
}

/// End of an adaptive series, with its reason and final state.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SeriesEnd {
    /// Reason.
    pub why: Ending,
    /// Final state.
    #[serde(flatten)]
    pub so_far: SoFar,
}

/// Reason for the end of an adaptive series.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// The requirement is met.
    Met,
    /// The maximum number of angles or fringes is reached.
    AtMost,
    /// The maximum number would not suffice.
    Cannot,
}

impl SeriesEnd {
    /// Text for the user: requirement, result, and remedy if it falls short.
    pub fn text(&self) -> String {
        match self.so_far {
            SoFar::Sigma(so_far) => self.of_angles(so_far),
            SoFar::Fringes(so_far) => self.of_fringes(so_far),
        }
    }

    fn of_fringes(&self, so_far: FringesSoFar) -> String {
        let FringesSoFar { fringes, undecided, until_undecided: wanted, at_most } = so_far;
        let percent = |part: f64| format!("{:.1} %", 100.0 * part);
        let is = undecided.map_or("no pixel has a first order on the panel".to_owned(), |u| {
            format!("{} of the pixels with a first order are undecided", percent(u))
        });
        let found = format!("{is} after {fringes} fringes, and {} was wanted", percent(wanted));
        let remedy = "expose longer, average more, or take several gratings in one pixel for what they are";
        match self.why {
            Ending::Met => found,
            Ending::AtMost => format!("{found}: the plan allows {at_most}; {remedy}"),
            Ending::Cannot => format!("{found}: the last ones did not help, so the series ended early; {remedy}"),
        }
    }

    fn of_angles(&self, so_far: SigmaSoFar) -> String {
        let SigmaSoFar { angles, sigma_deg, until_sigma_deg: wanted, at_most, least_deg } = so_far;
        let is = sigma_deg.map_or("no pixel carries an orientation".to_owned(), |s| format!("σ is {s:.3}°"));
        let found = format!("{is} after {angles} angles, and {wanted}° was wanted");
        let remedy = "expose longer or several times (exposures_ms), average more, or allow more angles";
        match self.why {
            Ending::Met => found,
            Ending::AtMost => format!("{found}: these are all angles that the plan allows; {remedy}"),
            Ending::Cannot => {
                let least =
                    least_deg.map_or("none would carry one".to_owned(), |s| format!("it would be {s:.3}° at least"));
                format!(
                    "{found}: after the {at_most} that the plan allows {least}, so the series ended early; {remedy}"
                )
            }
        }
    }
}
