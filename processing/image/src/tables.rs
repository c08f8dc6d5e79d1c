//! Numbers of maps in files of other programs: CSV, NPY and TIFF.

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::Path;

use nacre_base::{Error, Result};
use tiff::encoder::colortype::Gray32Float;
use tiff::encoder::{Compression, DeflateLevel, Rational, TiffEncoder};
use tiff::tags::{ResolutionUnit, Tag};

/// First line of a plane as CSV: columns are named with their units, as in `x_px,y_px,period_um`.
pub fn csv_head(name: &str, unit: &str) -> Vec<u8> {
    // A remark may follow the unit, as in "um (relative)".
    let unit = unit.split(' ').next().unwrap_or_default().replace('µ', "u");
    let unit = if unit.chars().all(|c| c.is_ascii_alphanumeric()) { unit } else { String::new() };
    let separator = if unit.is_empty() { "" } else { "_" };
    format!("x_px,y_px,{name}{separator}{unit}\n").into_bytes()
}

/// Rows of a plane as CSV, of which the first is row `first` of the plane: a line `x,y,value` per pixel, with an empty
/// value where masked.
pub fn csv_rows(values: &[f32], width: usize, first: usize) -> Vec<u8> {
    let mut text = String::new();
    for (row, values) in values.chunks_exact(width.max(1)).enumerate() {
        let y = first + row;
        for (x, v) in values.iter().enumerate() {
            text += &if v.is_finite() { format!("{x},{y},{v}\n") } else { format!("{x},{y},\n") };
        }
    }
    text.into_bytes()
}

/// Header of a NumPy array of 32-bit floats in row-major order (format 1.0).
pub fn npy_head([width, height]: [usize; 2]) -> Vec<u8> {
    let mut header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({height}, {width}), }}");
    // The data begin at a multiple of 64 bytes.
    while (10 + header.len() + 1) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes());
    bytes
}

/// Rows of a plane in the format of a NumPy array.
pub fn npy_rows(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// Writes a plane of 32-bit floats as a deflated grey TIFF, NaN where masked. `pitch_um`, the pixel pitch in µm,
/// becomes the resolution in pixels per cm, `description` the ImageDescription.
///
/// # Errors
/// `Output` if the system refuses, or if the size does not fit the values.
pub fn write_tiff(path: &Path, values: &[f32], width: usize, pitch_um: Option<f64>, description: &str) -> Result<()> {
    let height = values.len() / width.max(1);
    let write = || -> std::result::Result<(), tiff::TiffError> {
        let file = BufWriter::new(File::create(path)?);
        let mut encoder = TiffEncoder::new(file)?.with_compression(Compression::Deflate(DeflateLevel::Balanced));
        let mut image = encoder.new_image::<Gray32Float>(width as u32, height as u32)?;
        image.encoder().write_tag(Tag::ImageDescription, description)?;
        if let Some(pitch) = pitch_um.filter(|p| *p > 0.0) {
            // Whole pixels per cm are too coarse, so the fraction is that of 10,000 µm over the pitch in nm.
            image.resolution(
                ResolutionUnit::Centimeter,
                Rational { n: 10_000_000, d: (1e3 * pitch).round().max(1.0) as u32 },
            );
        }
        image.write_data(values)
    };
    write().map_err(|error| Error::output(path, io::Error::other(error)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_and_arrays_have_their_formats() {
        let values = [1.0, f32::NAN, 3.0, 4.5, 5.0, 6.0];
        let csv = [csv_head("sigma", "rad"), csv_rows(&values[..3], 3, 0), csv_rows(&values[3..], 3, 1)].concat();
        assert_eq!(csv_head("dolp", ""), b"x_px,y_px,dolp\n");
        assert_eq!(csv_head("period", "µm (relative)"), b"x_px,y_px,period_um\n");
        assert_eq!(csv, b"x_px,y_px,sigma_rad\n0,0,1\n1,0,\n2,0,3\n0,1,4.5\n1,1,5\n2,1,6\n");
        let npy = [npy_head([3, 2]), npy_rows(&values)].concat();
        assert_eq!((npy.len() - 24) % 64, 0);
        assert!(npy.windows(6).any(|w| w == b"(2, 3)"));
        assert_eq!(npy[npy.len() - 4..], 6.0_f32.to_le_bytes());
    }
}
