//! Measurement of error against computing time, and of the limits of each method.
//!
//! A [`Study`] defines a parameter with its settings, scenes of increasing difficulty, and a function that runs a
//! setting on a scene. The runner measures each pair several times and stores every measurement in a file, so that an
//! interrupted chart can be continued. Each chart has two panels. The first shows time against error, with the Pareto
//! front of the settings. The second shows error against difficulty, with the fractions of masked and of confidently
//! wrong pixels.
//!
//! To define a study, construct a [`Study`]:
//!
//! ```
//! use nacre_studies::{Axis, Outcome, Plan, Scene, Setting, Study, measure};
//! use nacre_base::progress::Silent;
//! use std::time::Instant;
//!
//! let terms = [1.0, 2.0, 3.0, 4.0, 5.0];
//! let study = Study {
//!     name: "exponential",
//!     group: "examples",
//!     title: "Terms of the exponential series".into(),
//!     question: "How many terms does exp(x) need?".into(),
//!     knob: Axis::linear("terms", ""),
//!     stress: Axis::log("x", ""),
//!     error: Axis::log("relative error", ""),
//!     time: Axis::log("time", "s"),
//!     predicted: "",
//!     settings: terms.map(|n| Setting::new("Taylor", format!("{n} terms"), n)).to_vec(),
//!     scenes: [0.01, 0.1, 1.0].map(Scene::new).to_vec(),
//!     reference: 1,
//!     run: Box::new(move |setting, scene, _seed| {
//!         let x: f64 = [0.01, 0.1, 1.0][scene];
//!         let begun = Instant::now();
//!         let sum = (0..=setting).rev().fold(0.0, |sum, k| 1.0 + x * sum / (k + 1) as f64);
//!         let seconds = begun.elapsed().as_secs_f64();
//!         Ok(Outcome { error: Some((sum / x.exp() - 1.0).abs()), seconds, masked: 0.0, wrong: 0.0, predicted: None })
//!     }),
//! };
//! let folder = tempfile::tempdir().unwrap();
//! let records = measure(&study, &Plan::new(1, "0.1.0"), &folder.path().join("raw.jsonl"), &Silent)?;
//! assert_eq!(records.len(), 5 * 3 * 5);
//! # Ok::<(), nacre_base::Error>(())
//! ```

mod chart_format;
mod folder;
pub mod gpu;
mod machine;
mod overview;
mod page;
mod pareto;
mod picture;
mod plan;
pub mod polarimetry;
mod raw;
mod runner;
mod study;
mod style;
mod summary;
mod sweep;
mod tables;
mod trade;

#[cfg(test)]
mod tests;

pub use chart_format::{ChartFormat, Width};
pub use folder::{Chart, Charted, Drawn, Picture, Request, catalogue, chart};
pub use machine::Machine;
pub use nacre_plot::{Scale, png_from_svg};
pub use pareto::pareto_front;
pub use plan::{Effort, Plan};
pub use raw::Record;
pub use runner::measure;
pub use study::{Axis, Outcome, Run, Scene, Setting, Study};
pub use summary::{Point, Quartiles, Summary, summarize};
