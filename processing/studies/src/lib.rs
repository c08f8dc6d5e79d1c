//! Speed against accuracy, and where a method breaks: what every method of this crate is charted with.
//!
//! A [`Study`] names a knob and its settings, scenes of rising difficulty, and how one setting is run on one scene. The
//! runner measures each pair several times and keeps every measurement in a file, so that an interrupted chart goes on
//! where it stopped. From the measurements come, side by side, the time against the error with the front of the settings
//! that nothing beats, and the error against the difficulty with the shares of pixels that were masked and of those that
//! are wrong and say otherwise.
//!
//! A study of one's own is a value of [`Study`]:
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

mod folder;
pub mod gpu;
mod look;
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

pub use folder::{Chart, Charted, Drawn, Picture, Request, catalogue, chart};
pub use look::{Look, Width};
pub use machine::Machine;
pub use nacre_plot::{Scale, png_from_svg};
pub use pareto::pareto_front;
pub use plan::{Effort, Plan};
pub use raw::Record;
pub use runner::measure;
pub use study::{Axis, Outcome, Run, Scene, Setting, Study};
pub use summary::{Point, Quartiles, Summary, summarize};
