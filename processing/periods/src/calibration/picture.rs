//! Picture of a chessboard, to print or to display.

use super::corners::Board;
use nacre_base::{Error, Result};

/// Picture of a board in the centre of `size_px`, with squares of `square_px` pixels: 0 or 255, top row first. The
/// upper left square is dark.
///
/// # Errors
/// `Input` unless it fits with a white margin of half a square.
pub fn board_picture(board: &Board, size_px: [u32; 2], square_px: u32) -> Result<Vec<u8>> {
    board.check()?;
    let squares = [board.columns as u32 + 1, board.rows as u32 + 1];
    let fits = square_px >= 4
        && size_px.iter().all(|n| (1..=16384).contains(n))
        && (0..2).all(|k| u64::from(squares[k] + 1) * u64::from(square_px) <= u64::from(size_px[k]));
    // An odd margin would displace the board by half a pixel from the centre.
    let even = (0..2).all(|k| (size_px[k] % 2) == (squares[k] % 2) * (square_px % 2));
    if !fits || !even {
        let problem = format!(
            "of {square_px} px squares does not fit into the middle of {} × {} px with a margin",
            size_px[0], size_px[1]
        );
        return Err(Error::input(
            "board",
            problem,
            "choose other squares (an even number of at least 4 px) or fewer corners",
        ));
    }
    let start = [0, 1].map(|k| (size_px[k] - squares[k] * square_px) / 2);
    let value = |i: usize| {
        let at = [i as u32 % size_px[0], i as u32 / size_px[0]];
        let square = [0, 1].map(|k| at[k].checked_sub(start[k]).map(|p| p / square_px).filter(|s| *s < squares[k]));
        match square {
            [Some(x), Some(y)] if (x + y) % 2 == 0 => 0,
            _ => 255,
        }
    };
    Ok((0..size_px[0] as usize * size_px[1] as usize).map(value).collect())
}
