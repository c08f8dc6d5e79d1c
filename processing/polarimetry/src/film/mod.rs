//! Models of films on gratings: the curve of points (S1/S0, S2/S0), its fit to a sample of pixels, and model selection.
//! The selected model gives the orientation of every pixel.

pub(crate) mod asked;
pub(crate) mod check;
pub(crate) mod choose;
#[cfg(test)]
mod choose_tests;
pub(crate) mod classes;
pub(crate) mod cloud;
pub(crate) mod correction;
pub(crate) mod curve;
pub(crate) mod curve_fit;
pub(crate) mod evidence;
pub(crate) mod foot;
pub(crate) mod likeliest;
pub(crate) mod locate;
pub(crate) mod mixture;
pub(crate) mod models;
pub(crate) mod normal;
pub(crate) mod oblique;
pub(crate) mod places;
pub(crate) mod pulls;
pub(crate) mod search;
pub(crate) mod spots;
pub(crate) mod stand;
pub(crate) mod starts;
pub(crate) mod sums;
pub(crate) mod weights;
