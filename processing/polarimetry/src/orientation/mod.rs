//! From Stokes parameters to maps: orientation, edges, smoothing and periods.

pub(crate) mod edges;
pub(crate) mod orient;
pub(crate) mod period;
pub(crate) mod period_map;
pub(crate) mod polarizers;
pub(crate) mod smooth;
