//! Polarization imaging: photographs behind a rotating analyser give the polarization angle, and thereby the
//! orientation of a grating, of every pixel (2018 paper, section 5).
//!
//! Any light behind a linear analyser at angle ψ has the intensity `I(ψ) = (S0 + S1 cos 2ψ + S2 sin 2ψ) / 2` (Malus).
//! The fit is linear in three unknowns, valid for any set of angles, and can process frames one by one:
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

mod angles;
mod film;
mod fit;
mod memory;
mod options;
mod orientation;
mod precision;
mod preview;
mod reconstruct;
mod report;
mod running;
mod solve;
pub mod synthetic;
#[cfg(test)]
mod tests;

pub use angles::angle_error::{angle_errors, angle_sigma};
pub use angles::repeats::RepeatsReport;
pub use film::camera_position::Oblique;
pub use film::check::{CircleCheck, check_circle};
pub use film::correction::ObliqueReport;
pub use film::models::Model;
pub use film::solve_options::{SAMPLE_PIXELS, SolveOptions};
pub use fit::demosaic::{Demosaic, demosaiced};
pub use fit::design::Design;
pub use fit::noise::estimate_noise;
pub use fit::views::MAX_BRACKET;
pub use fit::{Fit, StokesMaps, fit_stack};
pub use memory::{check_memory, work, work_of};
pub use nacre_frames::{FrameNoise, Illumination, NoiseModel, NoiseSource};
pub use nacre_image::registration::{Align, Alignment};
pub use nacre_optics::polarization::{Jones, JonesVector, Material, Stokes, angle_difference};
pub use options::Options;
pub use orientation::orient::{MASK_SNR, OrientationMaps, orient};
pub use orientation::period::{PeriodMaps, PeriodScale, polarization_of, relative_period};
pub use orientation::period_map::{Metal, PeriodMethod, PeriodReport};
pub use orientation::polarizers::widen_between_polarizers;
pub use orientation::smooth::{Smoothing, smooth, smoothed_orientation};
pub use precision::{Precision, UNREACHABLE_FACTOR};
pub use preview::{AppliedCorrections, Point, Preview, Probe, is_polarimetric, probe};
pub use reconstruct::reconstruct;
pub use report::compare::{Comparison, compare};
pub use report::errors::{AngleSource, ErrorReport};
pub use report::json::{Report, SensorReport, SmoothingReport};
pub use report::model_report::{FilmReport, ModelReport};
pub use running::Running;
pub use solve::orient_with;
