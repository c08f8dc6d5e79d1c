//! Polarization imaging: the angle of light's polarization behind a turning analyser gives the orientation of a
//! grating, pixel by pixel (2018 paper, section 5).
//!
//! Any light behind a linear analyser at angle ψ has the intensity `I(ψ) = (S0 + S1 cos 2ψ + S2 sin 2ψ) / 2`
//! (Malus). So the fit is linear in three unknowns, exact for any set of angles, and needs no stack of frames:
//!
//! ```
//! use nacre_polarimetry::{Design, Fit};
//!
//! let angles = [0.0_f64, 45.0, 90.0, 135.0].map(f64::to_radians);
//! let mut fit = Fit::new(1, 1);
//! for psi in angles {
//!     let intensity = 0.5 * (2.0 + 0.3 * (2.0 * psi).cos() + 0.4 * (2.0 * psi).sin());
//!     fit.add(psi, |_row, values, _bad| values[0] = intensity as f32);
//! }
//! let maps = fit.solve(&Design::new(&angles)?);
//! assert!((maps.s1[0] - 0.3).abs() < 1e-6 && (maps.s2[0] - 0.4).abs() < 1e-6);
//! # Ok::<(), nacre_base::Error>(())
//! ```

mod aligned;
mod angle_error;
mod arcs;
#[cfg(test)]
mod bracket_tests;
mod check;
mod choose;
#[cfg(test)]
mod choose_tests;
mod cloud;
mod compare;
mod correction;
mod count;
mod curve;
mod curve_fit;
mod design;
mod disk;
mod edges;
mod errors;
#[cfg(test)]
mod errors_tests;
mod evidence;
mod fit;
mod foot;
mod likeliest;
mod locate;
mod look;
mod memory;
mod merge;
mod mixture;
mod model_report;
mod models;
mod noise;
mod normal;
mod oblique;
mod orient;
mod output;
mod period;
mod period_map;
mod places;
#[cfg(test)]
mod plain_tests;
mod precision;
#[cfg(test)]
mod precision_tests;
mod reconstruct;
mod reduced;
mod repeats;
#[cfg(test)]
mod repeats_tests;
mod report;
mod running;
mod sample;
mod search;
mod smooth;
mod spots;
mod starts;
mod sums;
pub mod synthetic;
mod views;
mod weighted;
mod weights;

pub use angle_error::{angle_sigma, misses};
pub use check::{CircleCheck, check_circle};
pub use compare::{Comparison, compare};
pub use correction::{Oblique, ObliqueReport};
pub use design::Design;
pub use errors::{AngleSource, ErrorReport};
pub use fit::{Fit, StokesMaps, fit_stack};
pub use look::{Glance, Point, Probe, PutRight, is_polarimetric, probe};
pub use memory::check_memory;
pub use model_report::{FilmReport, ModelReport};
pub use models::Model;
pub use nacre_frames::{FrameNoise, NoiseModel, NoiseSource};
pub use nacre_image::registration::{Align, Alignment};
pub use nacre_optics::polarization::{Jones, JonesVector, Material, Stokes, angle_difference};
pub use noise::estimate_noise;
pub use orient::{MASK_SNR, OrientationMaps, orient};
pub use period::{PeriodMaps, PeriodScale, polarization_of, relative_period};
pub use period_map::{Metal, PeriodMethod, PeriodReport};
pub use precision::Precision;
pub use reconstruct::{Asked, CLOUD, orient_with};
pub use reconstruct::{Options, reconstruct};
pub use repeats::RepeatsReport;
pub use report::{Report, SmoothingReport};
pub use running::Running;
pub use smooth::{Smoothing, smooth, smoothed_orientation};
pub use views::MAX_BRACKET;
