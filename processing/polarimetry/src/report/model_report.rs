//! Report of the model selection: all candidates, and warnings.

use crate::film::choose::{Choice, PLAUSIBLE_DELTA, PLAUSIBLE_SIGMAS, UNEXPLAINED};
use crate::film::curve::Film;
use crate::film::search::at_limit;
use schemars::JsonSchema;
use serde::Serialize;

/// A candidate in the report.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct ModelReport {
    /// Name; for curves with the parameters fitted beyond the film.
    pub model: String,
    /// Number of parameters.
    pub parameters: usize,
    /// Penalised −2 ln likelihood relative to the best model: 0 for the best, 10 for one that is 150 times less likely.
    pub behind: f64,
    /// Scatter of the points about the curve relative to their noise, as a ratio of standard deviations; 1 for a
    /// perfect model.
    pub scatter: f64,
    /// 68 % quantile of the orientation differences from the selected model, in degrees.
    pub difference_deg: f64,
    /// Error caused by the uncertainty of its parameters, in degrees.
    pub uncertain_deg: f64,
    /// Centre of the circle.
    pub center: Option<[f64; 2]>,
    /// The film, for curves.
    pub film: Option<FilmReport>,
}

/// A fitted film. Two ambiguities remain: one offset common to all orientations, and (r, ζ) versus (1/r, -ζ) with all
/// orientations rotated by 90°.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct FilmReport {
    /// |R|.
    pub r: f64,
    /// Phase of R in degrees.
    pub zeta_deg: f64,
    /// Retardance (Δn) in degrees.
    pub retardance_deg: f64,
    /// Azimuth of its axis in degrees.
    pub axis_deg: f64,
    /// Front reflection: amplitude.
    pub front: f64,
    /// Front reflection: phase in degrees.
    pub front_phase_deg: f64,
    /// Retardance error of the retarder, relative to a quarter wave, in degrees.
    pub source_error_deg: f64,
    /// Share of unpolarised light.
    pub stray: f64,
}

impl Choice {
    /// The films of the curves among the candidates.
    pub fn films(&self) -> Vec<Film> {
        self.candidates.iter().filter_map(|c| c.film).collect()
    }

    /// Scatter of the points about the curve relative to their noise, as a ratio of standard deviations.
    pub fn scatter(&self) -> f64 {
        self.widened.sqrt()
    }

    /// Warnings for the user.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = vec![];
        let scatter = self.scatter();
        if !self.explained {
            warnings.push(format!(
                "the points (S1/S0, S2/S0) lie {scatter:.0} times farther from the curve of this model than their noise: it does \
                 not explain the data, and orientations may be wrong by much more than σ says"
            ));
        } else if self.widened > UNEXPLAINED {
            warnings.push(format!(
                "the points (S1/S0, S2/S0) scatter {scatter:.1} times as far about the curve as their noise: a sample of several \
                 periods, a wrong analyser angle or photographs that do not match; how far orientations are wrong in all cannot be told"
            ));
        }
        if self.candidates[self.chosen].curve.mirror.is_some() {
            let unknown =
                if self.error.is_some() { "" } else { "; how far orientations are wrong in all cannot be told" };
            warnings.push(format!("metal without a grating is in view, and masked{unknown}"));
        }
        if self.candidates[self.chosen].film.is_some_and(|film| at_limit(&film)) {
            warnings.push(
                "the film delays by more than 90°, the most that is looked for: if it delays yet more, orientations are wrong by much \
                 more than σ says"
                    .into(),
            );
        }
        let undecided = |k: &usize| {
            let behind = self.behind[*k] - self.behind[self.assumed];
            behind < PLAUSIBLE_DELTA.max(PLAUSIBLE_SIGMAS * self.difference_sigma[*k])
        };
        let rivals = (0..self.behind.len()).filter(|k| undecided(&self.chosen) && undecided(k));
        let difference = rivals.map(|k| self.differences[k]).fold(0.0, f64::max).to_degrees();
        if difference > 0.5 {
            warnings.push(format!(
                "another model explains the data as well, with orientations that differ by up to {difference:.1}° for 68 % of the pixels: see models"
            ));
        }
        let chosen = &self.candidates[self.chosen];
        // One of the two is the model assumed to be true.
        let difference_sigma = self.difference_sigma[self.best()].max(self.difference_sigma[self.chosen]);
        if self.behind[self.chosen] > PLAUSIBLE_DELTA.max(PLAUSIBLE_SIGMAS * difference_sigma) && self.error.is_some() {
            warnings.push(format!(
                "{} is not the likeliest model: another one gives orientations that differ by up to {:.1}° for 68 % of the pixels",
                chosen.name(),
                self.differences[self.best()].to_degrees()
            ));
        }
        warnings
    }

    fn best(&self) -> usize {
        (0..self.behind.len()).min_by(|a, b| self.behind[*a].total_cmp(&self.behind[*b])).unwrap_or(self.chosen)
    }

    /// All candidates.
    pub fn report(&self) -> Vec<ModelReport> {
        let each = self.candidates.iter().zip(&self.behind).zip(&self.differences);
        each.map(|((c, behind), difference)| ModelReport {
            model: c.name(),
            parameters: c.parameters,
            behind: *behind,
            scatter: c.widened.sqrt(),
            difference_deg: difference.to_degrees(),
            uncertain_deg: c.uncertain.to_degrees(),
            center: c.center,
            film: c.film.map(FilmReport::of),
        })
        .collect()
    }
}

impl FilmReport {
    fn of(film: Film) -> Self {
        let film = film.canonical();
        Self {
            r: film.ln_r.exp(),
            zeta_deg: film.zeta.to_degrees(),
            retardance_deg: film.retardance.to_degrees(),
            axis_deg: film.axis.to_degrees(),
            front: film.front.norm(),
            front_phase_deg: film.front.arg().to_degrees(),
            source_error_deg: film.source_error.to_degrees(),
            stray: film.stray,
        }
    }
}
