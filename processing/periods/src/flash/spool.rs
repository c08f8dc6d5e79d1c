//! Copies of the tile under each light, stored on disk.

use super::photographs::Photograph;
use super::tiling::Tiling;
use super::view::View;
use nacre_base::Result;
use nacre_image::Spool;
use rayon::prelude::*;

/// Empty spool of a tile's copies: by row, column and copy, each with light and variance.
pub(super) fn of_copies(tiling: &Tiling) -> Spool {
    Spool::new(2 * tiling.width * tiling.origins.len())
}

/// Adds all tiles of a photograph.
///
/// # Errors
/// As [`Spool::add`].
pub(super) fn add(spool: &mut Spool, photograph: &Photograph, tiling: &Tiling, view: &View) -> Result<()> {
    let row = tiling.width * tiling.origins.len();
    // About 4 MiB of copies are interpolated by all threads before they are written.
    let rows_at_once = (4 << 20) / (8 * row).max(1) + 1;
    let of_row = |y: usize| {
        let copy = |i: usize| {
            let place = tiling.place(i % tiling.origins.len(), i / tiling.origins.len(), y);
            view.pixel(place).map_or([f32::NAN; 2], |pixel| photograph.at(pixel))
        };
        (0..row).flat_map(copy).collect::<Vec<f32>>()
    };
    let rows = (0..tiling.height).step_by(rows_at_once).flat_map(|first| {
        let last = (first + rows_at_once).min(tiling.height);
        (first..last).into_par_iter().map(of_row).collect::<Vec<_>>()
    });
    spool.add(rows.flatten())
}
