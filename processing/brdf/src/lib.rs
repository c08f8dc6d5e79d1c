//! Diffraction of light by height fields: Stam's BRDF (1999) by several methods (2014 thesis), and exact efficiencies
//! of grating orders (2018 paper).
//!
//! - [`height`]: height fields from files and formulas, and their quality.
//! - [`map`]: X, Y, Z over all viewing directions. [`slice()`]: spectra along a half circle. [`check()`]: peaks
//!   compared with the grating equation.
//! - [`tables`]: tables over pairs of directions, for other programs.
//! - [`Section`]: efficiencies of a grating's orders from its cross-section.
//!
//! The theory is scalar: single reflection, no polarization, periods of several wavelengths. For rigorous theory, see
//! [`nacre_optics::rcwa`].
//!
//! The peaks of a blazed grating of 2.5 µm at 75°, as in the thesis (section 5.3):
//!
//! ```
//! use nacre_base::progress::Silent;
//! use nacre_brdf::height::{Profile, Quality, Shape, Synthetic};
//! use nacre_brdf::{Settings, check};
//!
//! let shape = Shape::Grating(Profile::Blazed);
//! let field = Synthetic { shape, pixels: 120, pixel_um: 0.0625, period_um: 2.5, depth_um: 0.3, angle: 0.0 }.field()?;
//! let quality = Quality::of(&field, 65.0);
//! let settings = Settings { light_deg: [75.0, 0.0], ..Settings::default() };
//! let found = check(&field, &quality, &settings, &[450.0, 550.0, 650.0], [None; 2], &Silent)?;
//! assert!((found.mean_nm - 2500.0).abs() < 1.0);
//! # Ok::<(), nacre_base::Error>(())
//! ```

mod bank;
mod brdf;
mod check;
mod choose;
mod densities;
mod engine;
mod expansion;
mod figure;
mod fresnel;
pub mod gems;
mod geometry;
pub mod height;
mod job;
mod lattice;
mod measured;
mod orders;
pub mod output;
mod peaks;
mod pq;
mod reference;
mod report;
mod settings;
mod slits;
mod spectral;
pub mod tables;
mod terms;
#[cfg(test)]
mod terms_tests;
#[cfg(test)]
mod tests;
mod transform;

pub use brdf::{Map, Slice, Views, map, slice};
pub use check::{GratingCheck, Peak, check};
pub use choose::{Choice, name};
pub use densities::{Densities, Workspace};
pub use expansion::{chebyshev_terms, taylor_terms};
pub use fresnel::{MATERIALS, Reflectance};
pub use geometry::{Direction, Pair, Window};
pub use height::HeightField;
pub use job::{MapReport, Options};
pub use orders::{OrderMethod, Section, most_orders};
pub use peaks::peaks_picture;
pub use report::Report;
pub use settings::{Method, Normalisation, SIZES, Settings};
pub use slits::Slits;
pub use spectral::RANGE_NM;
pub use terms::{TERMS_FILE, TermSet, Terms, TermsAbout, TermsRequest};
