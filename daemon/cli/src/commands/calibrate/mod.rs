//! `nacre calibrate`.

mod board;
mod geometry;
mod highlight;
mod panel;

use crate::console::Console;
use clap::Subcommand;
use nacre_capture::Failure;

/// What to measure of a bench.
#[derive(Subcommand)]
pub enum Calibrate {
    /// Camera, sample, panel, light and wavelength: a geometry.json.
    Geometry(Box<geometry::Geometry>),
    /// A chessboard to print or to show on the panel.
    Board(board::BoardPicture),
    /// The panel's tone curve, and whether a pattern is there when the panel says so, as the camera sees them.
    Panel(panel::Panel),
}

/// Runs it.
pub fn run(command: &Calibrate, console: &Console) -> Result<(), Failure> {
    match command {
        Calibrate::Geometry(args) => args.run(console),
        Calibrate::Board(args) => args.run(console),
        Calibrate::Panel(args) => args.run(console),
    }
}

/// Inner corners of a board, `9x6`.
fn shape(text: &str) -> Result<[usize; 2], String> {
    let wrong = || format!("{text:?} is no board; give its inner corners, such as 9x6");
    let (columns, rows) = text.split_once(['x', '×']).ok_or_else(wrong)?;
    let number = |t: &str| t.trim().parse().map_err(|_| wrong());
    Ok([number(columns)?, number(rows)?])
}
