//! Copies of the tile under every light, kept on disk: memory does not grow with the number of photographs.

use super::photographs::Photograph;
use super::tiling::Tiling;
use super::view::View;
use nacre_base::{Error, Result};
use rayon::prelude::*;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::os::unix::fs::FileExt;

/// Bytes of a copy: light and variance.
const BYTES: usize = 8;

/// One file per light: rows of the tile, in them columns, in them copies.
pub(super) struct Spool {
    files: Vec<File>,
    row: usize,
}

fn failed(e: std::io::Error) -> Error {
    let remedy = "make room for temporary files, or set TMPDIR";
    Error::input("temporary folder", format!("cannot hold copies of the tile: {e}"), remedy)
}

impl Spool {
    /// Nothing yet.
    pub fn new(tiling: &Tiling) -> Self {
        Self { files: vec![], row: tiling.width * tiling.origins.len() }
    }

    /// Adds what a photograph shows of all tiles.
    ///
    /// # Errors
    /// `Input` when there is no room for temporary files.
    pub fn add(&mut self, photograph: &Photograph, tiling: &Tiling, view: &View) -> Result<()> {
        let file = tempfile::tempfile().map_err(failed)?;
        let mut writer = BufWriter::with_capacity(1 << 20, &file);
        let rows_at_once = (4 << 20) / (self.row * BYTES).max(1) + 1;
        for first in (0..tiling.height).step_by(rows_at_once) {
            let last = (first + rows_at_once).min(tiling.height);
            let of_row = |y: usize| {
                let copy = |i: usize| {
                    let place = tiling.place(i % tiling.origins.len(), i / tiling.origins.len(), y);
                    view.pixel(place).map_or([f32::NAN; 2], |pixel| photograph.at(pixel))
                };
                (0..self.row).flat_map(copy).flat_map(f32::to_le_bytes).collect::<Vec<u8>>()
            };
            let rows: Vec<Vec<u8>> = (first..last).into_par_iter().map(of_row).collect();
            rows.iter().try_for_each(|row| writer.write_all(row)).map_err(failed)?;
        }
        writer.flush().map_err(failed)?;
        drop(writer);
        self.files.push(file);
        Ok(())
    }

    /// Copies of a row of the tile: by light, then column, then tile.
    ///
    /// # Errors
    /// `Input` when a temporary file cannot be read back.
    pub fn row(&self, y: usize) -> Result<Vec<Vec<[f32; 2]>>> {
        let read = |file: &File| {
            let mut bytes = vec![0; self.row * BYTES];
            file.read_exact_at(&mut bytes, (y * self.row * BYTES) as u64).map_err(failed)?;
            let number = |b: &[u8]| f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
            Ok(bytes.chunks_exact(BYTES).map(|b| [number(&b[..4]), number(&b[4..])]).collect())
        };
        self.files.iter().map(read).collect()
    }
}
