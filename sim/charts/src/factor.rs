//! Study of factorisations (kinds and parts), for separable and non-separable patterns.

use super::environment::{EXTENT, Last, Pattern, room};
use nacre_base::Result;
use nacre_base::progress::Silent;
use nacre_render::environment::factor::{Factors, Kind, Settings};
use nacre_render::environment::{Environment, Table};
use nacre_sim::random::{key, uniform};
use nacre_studies::{Axis, Effort, Outcome, Scene, Setting, Study};
use std::time::Instant;

/// Names and patterns.
const PATTERNS: [(&str, Pattern); 5] = [
    ("one streak", Pattern::Streaks(&[30.0])),
    ("lattice", Pattern::Spots([0.0, 90.0])),
    ("two streaks", Pattern::Streaks(&[45.0, 135.0])),
    ("three streaks", Pattern::Streaks(&[10.0, 70.0, 130.0])),
    ("rings", Pattern::Rings),
];

/// Name, label, kind, number of parts and target relative error of each factorisation.
const WAYS: [(&str, &str, Kind, usize, f64); 9] = [
    ("singular", "20 %", Kind::Singular, 1, 0.2),
    ("singular", "10 %", Kind::Singular, 1, 0.1),
    ("singular", "5 %", Kind::Singular, 1, 0.05),
    ("singular", "2 %", Kind::Singular, 1, 0.02),
    ("two parts", "2 parts, 5 %", Kind::Singular, 2, 0.05),
    ("three parts", "3 parts, 5 %", Kind::Singular, 3, 0.05),
    ("nonnegative", "nonnegative, 5 %", Kind::Nonnegative, 1, 0.05),
    ("line", "line, 5 %", Kind::Line, 1, 0.05),
    ("line", "line, 2 parts, 5 %", Kind::Line, 2, 0.05),
];

/// A lookup table, and an environment on which to time the two passes.
struct Job {
    environment: Environment,
    table: Table,
}

pub(super) fn study(effort: Effort) -> Study {
    let [columns, size] = effort.pick([512, 192], [128, 64]);
    let spot = 0.02_f64.max(1.4 / size as f64);
    let last = Last::new();
    let setting = |(k, (method, label, _, parts, error)): (usize, &(&str, &str, Kind, usize, f64))| {
        let setting = Setting::new(method, *label, *error);
        match k {
            2 => setting.as_default(),
            0 | 1 | 3 => setting.without_sweep(),
            _ if *method == "line" && *parts > 1 => setting.without_sweep(),
            _ => setting,
        }
    };
    Study {
        name: "factor",
        group: "environment",
        title: "Kinds and parts of a factorisation".into(),
        question: format!(
            "Which factorisation of a table of {size} × {size} entries (half vectors up to {EXTENT}) suits which pattern (`nacre factor --kind --parts --max-error`)? By default \
             singular vectors of one part, as many terms as 5 % of the table need. The error is that of a picture under one light that is a point, root mean square over its \
             mean: the largest that any environment has. Times are those of the two passes over an environment of {columns} × {} pixels. Masked: the report warns that \
             the error asked for was missed.",
            columns / 2
        ),
        knob: Axis::log("error of the table that is asked for", ""),
        stress: Axis::names("pattern"),
        error: Axis::log("error of a picture under a point", ""),
        time: Axis::log("time of the two passes", "s"),
        predicted: "",
        settings: WAYS.iter().enumerate().map(setting).collect(),
        scenes: PATTERNS.iter().enumerate().map(|(k, (name, _))| Scene::named(k, *name)).collect(),
        reference: 1,
        run: Box::new(move |setting, scene, seed| {
            // The seed varies the pattern's width by up to 10 %, so that runs differ.
            let width = spot * (1.0 + 0.1 * uniform(key(&[seed, 5])));
            let make = || {
                let table = PATTERNS[scene].1.table(size, width)?;
                Ok(Job { environment: room(columns, 1.5, seed)?, table })
            };
            measured(&*last.get(scene, seed, make)?, setting)
        }),
    }
}

fn measured(job: &Job, setting: usize) -> Result<Outcome> {
    let (_, _, kind, parts, max_error) = WAYS[setting];
    let factors = Factors::of(&job.table, &Settings { kind, parts, max_error, ..Settings::default() })?;
    let begun = Instant::now();
    factors.reflected(&job.environment, &Silent)?;
    let seconds = begun.elapsed().as_secs_f64();
    let masked = f64::from(u8::from(factors.missed()));
    Ok(Outcome { error: Some(factors.picture_error_point()), seconds, masked, wrong: 0.0, predicted: None })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The number of terms follows from the target error: several parts need fewer terms for three streaks. A line does
    /// not represent a lattice, and the report warns of it.
    #[test]
    fn kinds_and_parts_differ_as_patterns_do() {
        let study = study(Effort::Quick);
        let of = |setting, scene| (study.run)(setting, scene, 3).unwrap();
        assert!(of(0, 1).error.unwrap() > of(3, 1).error.unwrap());
        let lattice = of(7, 1);
        assert!(lattice.masked == 1.0 && lattice.error.unwrap() > 5.0 * of(2, 1).error.unwrap(), "{lattice:?}");
    }
}
