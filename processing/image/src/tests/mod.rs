//! Tests of reading and writing, with valid and damaged files; this module holds shared files.

mod arrays;
mod camera;
mod damage;
mod details;
mod exr_files;
mod formats;
mod hdr_files;
mod matrix;
mod palette;

use std::fs;
use std::path::{Path, PathBuf};

use ::image::{DynamicImage, ImageFormat};

use tiff::encoder::{Compression, TiffEncoder, colortype};

use super::*;

const W: usize = 13;
const H: usize = 7;

/// Reproducible pseudorandom numbers (xorshift).
struct Dice(u64);

impl Dice {
    fn roll(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }
}

fn bytes(channels: usize) -> Vec<u8> {
    let mut dice = Dice(channels as u64 + 1);
    (0..W * H * channels).map(|_| dice.roll() as u8).collect()
}

fn words(channels: usize) -> Vec<u16> {
    let mut dice = Dice(channels as u64 + 9);
    (0..W * H * channels).map(|_| dice.roll() as u16).collect()
}

fn floats(channels: usize) -> Vec<f32> {
    words(channels).into_iter().map(|w| f32::from(w) / 1000.0 - 7.0).collect()
}

fn kept<T: Copy>(all: &[T], stored: usize, kept: usize) -> Vec<T> {
    all.chunks(stored).flat_map(|pixel| pixel[..kept].to_vec()).collect()
}

fn check(path: &Path, channels: usize, depth: Depth, samples: Samples) {
    let expected = Info { width: W, height: H, channels, depth };
    assert_eq!(info(path).unwrap(), expected, "{}", path.display());
    assert_eq!(read(path).unwrap(), Raster { width: W, height: H, channels, samples }, "{}", path.display());
}

/// Black and white level stated by a file.
fn levels(path: &Path) -> nacre_base::Result<Option<[f64; 2]>> {
    details(path).map(|d| Some([d.black?, d.white?]))
}

fn png_file(dir: &Path, color: ::image::ExtendedColorType, data: &[u8]) -> PathBuf {
    let path = dir.join(format!("{color:?}.png"));
    ::image::save_buffer_with_format(&path, data, W as u32, H as u32, color, ImageFormat::Png).unwrap();
    path
}

/// PNG of given chunks, with their checksums.
fn raw_png(chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
    let crc = |bytes: &[u8]| {
        !bytes.iter().fold(!0_u32, |crc, byte| {
            (0..8).fold(crc ^ u32::from(*byte), |c, _| if c & 1 == 1 { (c >> 1) ^ 0xedb8_8320 } else { c >> 1 })
        })
    };
    let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
    for (name, data) in chunks {
        let body = [name.as_slice(), data].concat();
        file.extend((data.len() as u32).to_be_bytes());
        file.extend(&body);
        file.extend(crc(&body).to_be_bytes());
    }
    file
}

fn png_header(width: u32, height: u32, bits: u8, color: u8) -> Vec<u8> {
    [&width.to_be_bytes()[..], &height.to_be_bytes(), &[bits, color, 0, 0, 0]].concat()
}

fn tiff_file<C: colortype::ColorType>(dir: &Path, name: &str, compression: Compression, data: &[C::Inner]) -> PathBuf
where
    [C::Inner]: tiff::encoder::TiffValue,
{
    let path = dir.join(name);
    let file = fs::File::create(&path).unwrap();
    let mut encoder = TiffEncoder::new(file).unwrap().with_compression(compression);
    encoder.write_image::<C>(W as u32, H as u32, data).unwrap();
    path
}

fn jpeg_file(dir: &Path, rgb: bool) -> PathBuf {
    let path = dir.join(if rgb { "rgb.jpg" } else { "grey.jpg" });
    let (w, h) = (W as u32 * 5, H as u32 * 5);
    let picture = ::image::RgbImage::from_fn(w, h, |x, y| ::image::Rgb([(x * 3) as u8, (y * 7) as u8, 99]));
    let picture = DynamicImage::ImageRgb8(picture);
    if rgb {
        picture.save(&path).unwrap()
    } else {
        picture.to_luma8().save(&path).unwrap()
    }
    path
}

fn exr_file(path: &Path, channels: &[&str]) -> Vec<f32> {
    let data = floats(channels.len());
    let fill = |c: usize, row: usize, out: &mut [f32]| {
        for (x, value) in out.iter_mut().enumerate() {
            *value = data[(row * W + x) * channels.len() + c];
        }
    };
    write_exr(path, W, H, channels, &[], &fill).unwrap();
    data
}
