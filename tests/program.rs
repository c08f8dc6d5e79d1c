//! All end-to-end tests in one executable, because linking takes longer than most tests.
//!
//! `cargo test -p nacre-tests --test program kills::` runs one file.

mod assets;
mod bad_input;
mod bokeh;
mod brdf;
mod browser;
mod capture;
mod catalogue;
mod chart;
mod command_line;
mod connections;
mod contained;
mod disk;
mod emulated;
mod estimates;
mod faults;
mod files;
mod flash;
mod gpu;
mod guardian;
mod hdr;
mod kills;
mod limits;
mod lut;
mod manual;
mod one_device;
mod operations;
mod outside;
mod page;
mod panel;
mod periods;
mod render;
mod renders;
mod reported_errors;
mod resume;
mod salvage;
mod service;
mod soak;
mod spots;
mod trust;
mod unfit_files;
mod until;
mod uploads;
mod versions;
mod viewer;
