//! Median and quartiles over the runs.

use super::{Axis, Machine, Plan, Record, Scene, Setting, Study, pareto_front};
use serde::{Deserialize, Serialize};

/// Median and quartiles.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Quartiles {
    /// First quartile.
    pub q1: f64,
    /// Median.
    pub median: f64,
    /// Third quartile.
    pub q3: f64,
}

/// A setting on a scene, over all runs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Position in the settings.
    pub setting: usize,
    /// Position in the scenes.
    pub scene: usize,
    /// Number of runs.
    pub runs: usize,
    /// Error in its unit; `None` if most runs masked everything.
    pub error: Option<Quartiles>,
    /// Time in s.
    pub seconds: Quartiles,
    /// Median masked fraction.
    pub masked: f64,
    /// Median fraction of confidently wrong pixels.
    pub wrong: f64,
    /// Median expected error.
    pub predicted: Option<f64>,
    /// Whether it is Pareto-optimal on its scene.
    pub front: bool,
}

/// Results of a study.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Name of the study.
    pub name: String,
    /// Group of the study.
    pub group: String,
    /// Title.
    pub title: String,
    /// Question of the study.
    pub question: String,
    /// The parameter varied by the settings.
    pub knob: Axis,
    /// The quantity varied by the scenes.
    pub stress: Axis,
    /// The measured error.
    pub error: Axis,
    /// Quantity of the time axis.
    pub time: Axis,
    /// Name of the expected error.
    pub predicted: String,
    /// Settings.
    pub settings: Vec<Setting>,
    /// Scenes.
    pub scenes: Vec<Scene>,
    /// The scene of the time-against-error panel.
    pub reference: usize,
    /// Seed, runs, program.
    pub plan: Plan,
    /// The computer.
    pub machine: Machine,
    /// One point per setting and scene.
    pub points: Vec<Point>,
}

impl Quartiles {
    /// Quartiles of some numbers, interpolated between neighbours; `None` for an empty slice.
    pub fn of(values: &[f64]) -> Option<Self> {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let last = sorted.len().checked_sub(1)?;
        let at = |share: f64| {
            let position = share * last as f64;
            let (low, part) = (position.floor() as usize, position.fract());
            sorted[low] + part * (sorted[(low + 1).min(last)] - sorted[low])
        };
        Some(Self { q1: at(0.25), median: at(0.5), q3: at(0.75) })
    }
}

impl Summary {
    /// The point of a setting on a scene.
    pub fn point(&self, setting: usize, scene: usize) -> Option<&Point> {
        self.points.iter().find(|p| p.setting == setting && p.scene == scene)
    }

    /// Points of a scene with a known error, as `(position in points, seconds, error)`.
    pub(super) fn of_scene(&self, scene: usize) -> Vec<(usize, f64, f64)> {
        let points = self.points.iter().enumerate().filter(|(_, p)| p.scene == scene);
        points.filter_map(|(i, p)| Some((i, p.seconds.median, p.error?.median))).collect()
    }
}

/// Computes median and quartiles of every measured setting and scene.
pub fn summarize(study: &Study, plan: &Plan, records: &[Record]) -> Summary {
    let pairs = (0..study.settings.len()).flat_map(|s| (0..study.scenes.len()).map(move |c| (s, c)));
    let points = pairs.filter_map(|(setting, scene)| point(setting, scene, records)).collect();
    let mut summary = Summary {
        name: study.name.into(),
        group: study.group.into(),
        title: study.title.clone(),
        question: study.question.clone(),
        knob: study.knob.clone(),
        stress: study.stress.clone(),
        error: study.error.clone(),
        time: study.time.clone(),
        predicted: study.predicted.into(),
        settings: study.settings.clone(),
        scenes: study.scenes.clone(),
        reference: study.reference,
        plan: plan.clone(),
        machine: Machine::this(),
        points,
    };
    for scene in 0..study.scenes.len() {
        let known = summary.of_scene(scene);
        let front = pareto_front(&known.iter().map(|k| (k.1, k.2)).collect::<Vec<_>>());
        front.into_iter().for_each(|i| summary.points[known[i].0].front = true);
    }
    summary
}

fn point(setting: usize, scene: usize, records: &[Record]) -> Option<Point> {
    let of: Vec<_> = records.iter().filter(|r| r.setting == setting && r.scene == scene).map(|r| r.outcome).collect();
    let errors: Vec<f64> = of.iter().filter_map(|o| o.error).collect();
    let predicted: Vec<f64> = of.iter().filter_map(|o| o.predicted).collect();
    let median = |value: fn(&super::Outcome) -> f64| Quartiles::of(&of.iter().map(value).collect::<Vec<_>>());
    Some(Point {
        setting,
        scene,
        runs: of.len(),
        error: if 2 * errors.len() > of.len() { Quartiles::of(&errors) } else { None },
        seconds: median(|o| o.seconds)?,
        masked: median(|o| o.masked)?.median,
        wrong: median(|o| o.wrong)?.median,
        predicted: Quartiles::of(&predicted).map(|q| q.median),
        front: false,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quartiles_interpolate() {
        let q = Quartiles::of(&[4.0, 1.0, 3.0, 2.0]).unwrap();
        assert_eq!((q.q1, q.median, q.q3), (1.75, 2.5, 3.25));
        assert!(Quartiles::of(&[]).is_none());
    }
}
