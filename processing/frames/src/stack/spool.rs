//! Photographs as numbers on disk, read back row by row: memory does not grow with their number.

use nacre_base::{Error, Result};
use nacre_image::{Raster, Samples};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::os::unix::fs::FileExt;

/// Bytes of a number.
const BYTES: usize = size_of::<f32>();

/// One file per photograph.
pub struct Spool {
    files: Vec<File>,
    /// Numbers of a row.
    row: usize,
}

fn failed(error: std::io::Error) -> Error {
    let remedy = "make room for temporary files, or set TMPDIR";
    Error::input("temporary folder", format!("cannot hold the photographs: {error}"), remedy)
}

impl Spool {
    /// Nothing yet, for rows of so many numbers.
    pub fn new(row: usize) -> Self {
        Self { files: vec![], row }
    }

    /// Adds a photograph.
    ///
    /// # Errors
    /// `Input` when there is no room for temporary files.
    pub fn add(&mut self, photograph: &Raster) -> Result<()> {
        fn put<T: Copy>(values: &[T], number: impl Fn(T) -> f32, out: &mut impl Write) -> std::io::Result<()> {
            values.iter().try_for_each(|v| out.write_all(&number(*v).to_le_bytes()))
        }
        let file = tempfile::tempfile().map_err(failed)?;
        let mut out = BufWriter::with_capacity(1 << 20, &file);
        match &photograph.samples {
            Samples::U8(v) => put(v, f32::from, &mut out),
            Samples::U16(v) => put(v, f32::from, &mut out),
            Samples::F32(v) => put(v, |v| v, &mut out),
        }
        .and_then(|()| out.flush())
        .map_err(failed)?;
        drop(out);
        self.files.push(file);
        Ok(())
    }

    /// Number of photographs.
    pub fn len(&self) -> usize {
        self.files.len()
    }

    /// A row of every photograph.
    ///
    /// # Errors
    /// `Input` when a temporary file cannot be read back.
    pub fn row(&self, y: usize) -> Result<Vec<Vec<f32>>> {
        let read = |file: &File| {
            let mut bytes = vec![0; self.row * BYTES];
            file.read_exact_at(&mut bytes, (y * self.row * BYTES) as u64).map_err(failed)?;
            Ok(bytes.chunks_exact(BYTES).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect())
        };
        self.files.iter().map(read).collect()
    }
}
