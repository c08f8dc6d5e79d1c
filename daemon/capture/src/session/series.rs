//! The state and the end of a series that goes on until a stated uncertainty is reached.

use serde::{Deserialize, Serialize};

/// How well a series knows its orientations so far.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SigmaSoFar {
    /// Analyser angles in it.
    pub angles: usize,
    /// 90th percentile of σ in degrees over the pixels that carry an orientation; none when no pixel does.
    pub sigma_deg: Option<f64>,
    /// Wanted σ in degrees.
    pub until_sigma_deg: f64,
    /// Most angles.
    pub at_most: u32,
    /// What σ will be at least after the most angles, in degrees; none when no pixel will carry an orientation.
    pub least_deg: Option<f64>,
}

/// How much a spot scan knows so far.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FringesSoFar {
    /// Fringes in it.
    pub fringes: u32,
    /// Part of the pixels with a first order on the panel that several gratings explain, or whose period is less sure than wanted; none
    /// when no pixel has one.
    pub undecided: Option<f64>,
    /// Part that is allowed.
    pub until_undecided: f64,
    /// Most fringes.
    pub at_most: u32,
}

/// What a series that goes on until enough is known knows so far.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum SoFar {
    /// Of orientations behind an analyser.
    Sigma(SigmaSoFar),
    /// Of fringes on the panel.
    Fringes(FringesSoFar),
}

impl SoFar {
    /// A few words for a progress bar.
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

/// Why a series that goes on until enough is known has ended, and with what.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SeriesEnd {
    /// Why.
    pub why: Ending,
    /// What it knew then.
    #[serde(flatten)]
    pub so_far: SoFar,
}

/// Why a series that goes on until enough is known has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// What was wanted is reached.
    Met,
    /// All angles or fringes that the plan allows are taken.
    AtMost,
    /// All that the plan allows would not be enough.
    Cannot,
}

impl SeriesEnd {
    /// What a person should know: what is wanted, what came, and what to do where that is less.
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
