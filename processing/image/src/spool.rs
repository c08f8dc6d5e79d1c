//! Temporary storage on disk for rows of many pictures, so that memory does not grow with the number of pictures.

use nacre_base::{Error, Result};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::os::unix::fs::FileExt;

/// Bytes per number.
const BYTES: usize = size_of::<f32>();

/// Pictures in one temporary file, one after the other; all rows have the same length.
pub struct Spool {
    /// Temporary file, created with the first picture.
    file: Option<File>,
    /// Index of the first number of each picture.
    starts: Vec<u64>,
    /// Total of numbers.
    count: u64,
    /// Numbers per row.
    row: usize,
}

fn failed(error: std::io::Error) -> Error {
    let remedy = "make room for temporary files, or set TMPDIR";
    Error::input("temporary folder", format!("cannot hold the photographs: {error}"), remedy)
}

impl Spool {
    /// Creates an empty spool for rows of `row` numbers.
    pub fn new(row: usize) -> Self {
        Self { file: None, starts: vec![], count: 0, row }
    }

    /// Appends a picture, from its first row to its last.
    ///
    /// # Errors
    /// `Input` if there is no room for temporary files.
    pub fn add(&mut self, numbers: impl Iterator<Item = f32>) -> Result<()> {
        let file = match self.file.take() {
            Some(file) => file,
            None => tempfile::tempfile().map_err(failed)?,
        };
        self.starts.push(self.count);
        let mut out = BufWriter::with_capacity(1 << 20, &file);
        for number in numbers {
            out.write_all(&number.to_le_bytes()).map_err(failed)?;
            self.count += 1;
        }
        out.flush().map_err(failed)?;
        drop(out);
        self.file = Some(file);
        Ok(())
    }

    /// Number of pictures.
    pub fn count(&self) -> usize {
        self.starts.len()
    }

    /// Row `y` of every picture.
    ///
    /// # Errors
    /// `Input` if the temporary file cannot be read back.
    pub fn row(&self, y: usize) -> Result<Vec<Vec<f32>>> {
        let Some(file) = &self.file else { return Ok(vec![]) };
        let read = |start: &u64| {
            let mut bytes = vec![0; self.row * BYTES];
            let first = start + (y * self.row) as u64;
            file.read_exact_at(&mut bytes, first * BYTES as u64).map_err(failed)?;
            Ok(bytes.chunks_exact(BYTES).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect())
        };
        self.starts.iter().map(read).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_come_back_by_picture() {
        let mut spool = Spool::new(3);
        spool.add((0..6).map(|v| v as f32)).unwrap();
        spool.add((0..6).map(|v| -0.5 * v as f32)).unwrap();
        assert_eq!(spool.count(), 2);
        assert_eq!(spool.row(1).unwrap(), [[3.0, 4.0, 5.0], [-1.5, -2.0, -2.5]]);
        assert!(spool.row(2).is_err());
    }
}
