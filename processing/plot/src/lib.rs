#![doc = include_str!("../README.md")]

mod labels;
mod pdf;
mod png;
mod scale;
pub mod style;
pub mod svg;

pub use labels::{Labels, spread_out};
pub use pdf::pdf_from_svg;
pub use png::png_from_svg;
pub use scale::Scale;
