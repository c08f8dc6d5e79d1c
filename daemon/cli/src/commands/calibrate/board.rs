//! `nacre calibrate board`.

use super::shape;
use crate::commands::values::numbers;
use crate::console::Console;
use nacre_base::{Error, vacant};
use nacre_capture::Failure;
use nacre_image::{encode_png8, write_whole};
use nacre_periods::calibration::{Board, board_picture};
use std::path::PathBuf;

/// Arguments of `nacre calibrate board`.
#[derive(clap::Args)]
#[command(after_help = "\
Example:
  nacre calibrate board --board 9x6 --panel-px 1920,1080 --square-px 120 --out board.png")]
pub struct BoardPicture {
    /// Inner corners along a row and a column.
    #[arg(long, value_name = "9x6", default_value = "9x6", value_parser = shape)]
    board: [usize; 2],
    /// Width and height of the picture in pixels: those of the panel.
    #[arg(long, value_name = "W,H", value_parser = |t: &str| numbers::<u32, 2>(t, "width and height: 1920,1080"))]
    panel_px: [u32; 2],
    /// Side of a square in pixels.
    #[arg(long, value_name = "PX")]
    square_px: u32,
    /// Picture (PNG).
    #[arg(long, value_name = "FILE.png")]
    out: PathBuf,
    /// Replace an existing file.
    #[arg(long)]
    force: bool,
}

impl BoardPicture {
    /// Draws and writes the chessboard.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        vacant(std::slice::from_ref(&self.out), self.force)?;
        let [columns, rows] = self.board;
        let board = Board { columns, rows, square_mm: f64::from(self.square_px.max(1)) };
        let picture = board_picture(&board, self.panel_px, self.square_px)?;
        let [width, height] = self.panel_px.map(|n| n as usize);
        let encoded = encode_png8(width, height, 1, &picture).map_err(|e| Error::output(&self.out, e))?;
        write_whole(&self.out, &encoded)?;
        let text = format!(
            "board     {columns} × {rows} inner corners, squares of {} px\nwrote     {}",
            self.square_px,
            self.out.display()
        );
        let json = serde_json::json!({ "board": self.board, "square_px": self.square_px, "picture": self.out });
        console.result(&text, &json);
        Ok(())
    }
}
