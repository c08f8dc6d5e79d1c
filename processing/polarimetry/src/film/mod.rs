//! Models of films on gratings: the curve of points (S1/S0, S2/S0), its fit to a sample of pixels, and model selection.
//! The selected model gives the orientation of every pixel.

pub(crate) mod camera_position;
pub(crate) mod check;
pub(crate) mod choose;
#[cfg(test)]
mod choose_tests;
pub(crate) mod classes;
pub(crate) mod cloud;
pub(crate) mod correction;
pub(crate) mod curve;
pub(crate) mod curve_fit;
pub(crate) mod discrete_orientations;
pub(crate) mod evidence;
pub(crate) mod invert_curve;
pub(crate) mod max_likelihood;
pub(crate) mod mixing_weights;
pub(crate) mod models;
pub(crate) mod normal;
pub(crate) mod npmle;
pub(crate) mod oblique;
pub(crate) mod projection;
pub(crate) mod score;
pub(crate) mod search;
pub(crate) mod segment_means;
pub(crate) mod solve_options;
pub(crate) mod starts;
pub(crate) mod support_points;
