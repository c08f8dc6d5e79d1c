//! `nacre calibrate`.

mod board;
mod geometry;
mod highlight;
mod panel;

use super::calibrations::Keep;
use super::derived::Whole;
use crate::console::Console;
use clap::Subcommand;
use nacre_capture::Failure;

/// Calibrations of a bench.
#[derive(Subcommand)]
pub enum Calibrate {
    /// Measure camera, sample, panel, light and wavelength; writes a geometry.json.
    Geometry(Box<geometry::Geometry>),
    /// Measure gain, noise, full well and bad pixels of a camera.
    Camera(Whole<nacre_calibrate::camera::Options>),
    /// Measure the unevenness of light and lens (flat field).
    Flat(Whole<nacre_calibrate::flat::Options>),
    /// Measure zero, sense, extinction and eccentricity of the analyser.
    Analyser(Whole<nacre_calibrate::analyser::Options>),
    /// Measure azimuth and retardance of the panel's retarder.
    Retarder(Whole<nacre_calibrate::retarder::Options>),
    /// Measure the offset of orientations on a sample of known orientation.
    Orientation(Whole<nacre_calibrate::orientation::Options>),
    /// Store a calibration in a data folder, where sessions find it.
    Keep(Keep),
    /// Draw a chessboard to print or to show on the panel.
    Board(board::BoardPicture),
    /// Measure the panel's tone curve with the camera, and check that patterns appear when reported.
    Panel(panel::Panel),
}

/// Runs the selected command.
pub fn run(command: &Calibrate, console: &Console) -> Result<(), Failure> {
    match command {
        Calibrate::Geometry(args) => args.run(console),
        Calibrate::Camera(args) => args.run(console),
        Calibrate::Flat(args) => args.run(console),
        Calibrate::Analyser(args) => args.run(console),
        Calibrate::Retarder(args) => args.run(console),
        Calibrate::Orientation(args) => args.run(console),
        Calibrate::Keep(args) => args.run(console),
        Calibrate::Board(args) => args.run(console),
        Calibrate::Panel(args) => args.run(console),
    }
}

/// Parses the inner corners of a board, `9x6`.
fn shape(text: &str) -> Result<[usize; 2], String> {
    let wrong = || format!("{text:?} is no board; give its inner corners, such as 9x6");
    let (columns, rows) = text.split_once(['x', '×']).ok_or_else(wrong)?;
    let number = |t: &str| t.trim().parse().map_err(|_| wrong());
    Ok([number(columns)?, number(rows)?])
}
