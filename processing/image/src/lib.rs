//! Images: photographs of all usual formats as a [`Raster`], EXR maps with attributes, pictures with legends,
//! registration, and convolution.
//!
//! - [`read()`], [`info`] and [`details()`]: photographs, told by their content. Damaged files give an error, never a
//!   panic.
//! - [`write_exr`] and [`read_exr`]: maps of 32-bit floats, NaN where masked, with units and pixel pitch as attributes.
//! - [`orientation_picture`] and [`scalar_picture`]: maps as PNG pictures with a legend.
//! - [`registration`]: sub-pixel shifts between photographs behind a rotating analyser.
//!
//! Writing a map and reading it back:
//!
//! ```
//! use nacre_image::{Attribute, read_exr, write_exr};
//!
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("orientation.exr");
//! let unit = ("unit", Attribute::Text("rad".into()));
//! write_exr(&path, 640, 480, &["orientation"], &[unit], &|_channel, row, values| values.fill(0.001 * row as f32))?;
//!
//! let mut map = read_exr(&path)?;
//! assert_eq!(map.attributes["unit"], "rad");
//! let orientation = map.take("orientation", &path)?;
//! assert_eq!(orientation[100 * map.width], 0.1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod averaging;
mod bmp;
pub mod budget;
mod canvas;
mod convolution;
mod correlation;
mod details;
mod exif;
mod fault;
mod fits;
mod font;
mod foreign;
mod gray;
mod homography;
mod interpolation;
mod jpeg;
mod light;
mod listing;
pub mod lobe;
mod npy;
mod openexr;
mod palette;
mod picture;
mod png;
mod primaries;
mod radiance;
mod raster;
mod raw;
mod read;
pub mod registration;
mod scale_bar;
mod source;
mod spool;
mod tables;
#[cfg(test)]
mod tests;
mod tif;
mod tif_chunks;
mod tif_codecs;
mod webp;
mod write;
mod zip;

pub use averaging::Averaging;
pub use canvas::{Canvas, Rgb, text_width};
pub use convolution::Convolution;
pub use correlation::{Correlation, Field};
pub use details::{Curve, Details, Encoding, details};
pub use exif::{Exposure, Origin, exposure, origin};
pub use gray::Gray;
pub use homography::{homography, mapped};
pub use interpolation::catmull_rom;
pub use light::{Light, read_light};
pub use listing::{list, photograph_in, photographs};
pub use nacre_base::{OutputFolder, json, rewrite, sweep_unfinished, write_whole, write_whole_with};
pub use openexr::{ExrHeader, ExrMap, read_exr, read_exr_channel, read_exr_header, read_exr_rows};
pub use palette::{ColorTable, MASKED, Palette};
pub use picture::{orientation_picture, orientation_rows, scalar_picture, scalar_rows, viridis};
pub use raster::{Depth, Info, MAX_PIXELS, MAX_SIDE, Raster, Samples};
pub use raw::Decoding;
pub use read::{EXTENSIONS, info, read, read_into, size};
pub use spool::Spool;
pub use tables::{csv_head, csv_rows, npy_head, npy_rows, write_tiff};
pub use write::{
    Attribute, Precision, encode_png8, encode_png16_gray, write_exr, write_exr_as, write_png8, write_png16_gray,
};
pub use zip::write_exr_zip;
