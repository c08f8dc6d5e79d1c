#![doc = include_str!("../README.md")]
//!
//! A chart with a logarithmic axis:
//!
//! ```
//! use nacre_plot::svg::{Area, Axes, Ruler, Svg};
//! use nacre_plot::{Scale, png_from_svg};
//!
//! let data = [[4.0, 0.31], [8.0, 0.12], [16.0, 0.05]];
//! let area = Area::new(60.0, 20.0, 300.0, 160.0);
//! let x = Ruler::covering(Scale::Linear, data.map(|d| d[0]), area.x, area.x + area.w);
//! let y = Ruler::covering(Scale::Log, data.map(|d| d[1]), area.y + area.h, area.y);
//!
//! let mut svg = Svg::new(400.0, 240.0);
//! svg.polyline(&data.map(|d| [x.at(d[0]), y.at(d[1])]), "stroke=\"#1c2430\" fill=\"none\"");
//! Axes { area, x, y, names: &[], x_title: "photographs", y_title: "σ of orientation in °", percent: false }
//!     .draw(&mut svg);
//! let png = png_from_svg(&svg.finish("σ of orientation over the number of photographs"), 2.0)?;
//! assert!(png.starts_with(b"\x89PNG"));
//! # Ok::<(), nacre_base::Error>(())
//! ```

pub mod directions;
mod labels;
mod pdf;
mod png;
mod scale;
pub mod style;
pub mod svg;

pub use labels::{Labels, spread_out};
pub use pdf::{packed, pdf_from_svg};
pub use png::png_from_svg;
pub use scale::Scale;
