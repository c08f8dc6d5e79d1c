//! Bokeh photographs: an out-of-focus highlight on a grating shows the grating's lines (2017 paper, section 5).

pub mod deconvolution;
