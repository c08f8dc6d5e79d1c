//! Registry of all operations available to command line, service, plans and jobs.
//!
//! A new operation implements [`Operation`](nacre_base::operation::Operation) for its options and is listed here.

use nacre_base::operation::{Entry, Registered};
use nacre_lut::{bokeh, foil};
use nacre_periods::{calibration, flash, fringes};

/// All operations.
pub const OPERATIONS: &[&dyn Registered] = &[
    &Entry::<nacre_polarimetry::Options>::NEW,
    &Entry::<nacre_frames::hdr::Options>::NEW,
    &Entry::<nacre_frames::stack::Options>::NEW,
    &Entry::<nacre_lut::Settings>::NEW,
    &Entry::<bokeh::Options>::NEW,
    &Entry::<foil::Settings>::NEW,
    &Entry::<fringes::Settings>::NEW,
    &Entry::<flash::Settings>::NEW,
    &Entry::<nacre_brdf::Options>::NEW,
    &Entry::<nacre_maps::Options>::NEW,
    &Entry::<calibration::Options>::NEW,
    &Entry::<nacre_render::Options>::NEW,
    &Entry::<nacre_render::environment::factor::Options>::NEW,
    &Entry::<foil::SynthesizeOptions>::NEW,
    &Entry::<nacre_inspect::Options>::NEW,
    &Entry::<nacre_calibrate::camera::Options>::NEW,
    &Entry::<nacre_calibrate::flat::Options>::NEW,
    &Entry::<nacre_calibrate::analyser::Options>::NEW,
    &Entry::<nacre_calibrate::retarder::Options>::NEW,
    &Entry::<nacre_calibrate::orientation::Options>::NEW,
];

/// The operation with a name.
pub fn operation(name: &str) -> Option<&'static dyn Registered> {
    OPERATIONS.iter().copied().find(|o| o.name() == name)
}
