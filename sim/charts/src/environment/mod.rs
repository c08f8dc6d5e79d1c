//! Studies of environment lighting: number of separable terms, resolution of the lookup table and environment, number
//! of wavelengths, and method.

mod method;
mod scene;
mod sphere;

pub(super) use scene::{EXTENT, Last, Pattern, room};

use nacre_studies::{Axis, Effort, Outcome, Run, Scene, Setting, Study};

/// All studies of environment lighting.
pub fn studies(effort: Effort) -> Vec<Study> {
    let mut all = sphere::studies(effort);
    all.extend(method::studies(effort));
    all
}

/// The fields in which the studies of this module differ.
struct Draft {
    name: &'static str,
    title: &'static str,
    question: String,
    knob: Axis,
    stress: Axis,
    time: &'static str,
    predicted: &'static str,
    settings: Vec<Setting>,
    scenes: Vec<Scene>,
    reference: usize,
    run: Run,
}

impl Draft {
    fn study(self) -> Study {
        Study {
            name: self.name,
            group: "environment",
            title: self.title.into(),
            question: format!(
                "{} Twelve Gaussian lamps over a sky and a floor. The error is the root mean square of differences from the full integral \
                 over the integral's own mean.",
                self.question
            ),
            knob: self.knob,
            stress: self.stress,
            error: Axis::log("error of the picture", ""),
            time: Axis::log(self.time, "s"),
            predicted: self.predicted,
            settings: self.settings,
            scenes: self.scenes,
            reference: self.reference,
            run: self.run,
        }
    }
}

fn outcome(error: f64, seconds: f64, predicted: Option<f64>) -> Outcome {
    Outcome { error: Some(error), seconds, masked: 0.0, wrong: 0.0, predicted }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Checks on the easy scene that more terms reduce the error and that the passes as printed are worse.
    #[test]
    fn more_terms_and_the_right_passes_are_better() {
        let all = studies(Effort::Quick);
        let rank = all.iter().find(|s| s.name == "environment-rank").unwrap();
        let at = |label: &str, method: &str, scene: usize| {
            let found = rank.settings.iter().position(|s| s.label == label && s.method == method);
            (rank.run)(found.unwrap(), scene, 1).unwrap().error.unwrap()
        };
        let streaks = rank.scenes.iter().position(|s| s.label == "three streaks").unwrap();
        let [one, ten] = ["rank 1", "rank 10"].map(|label| at(label, "two passes", streaks));
        assert!(ten < 0.8 * one, "{one} {ten}");
        let [right, printed] = ["two passes", "as printed"].map(|method| at("rank 10", method, rank.reference));
        assert!(printed > 3.0 * right, "{right} {printed}");
        for study in &all {
            for setting in [0, study.settings.len() - 1] {
                let outcome = (study.run)(setting, study.reference, 2).unwrap();
                assert!(outcome.error.unwrap().is_finite(), "{}", study.name);
            }
        }
    }
}
