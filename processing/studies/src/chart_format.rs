//! Style of charts: with or without titles, for a screen or for a journal's columns.

use std::str::FromStr;

/// Style of charts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChartFormat {
    /// Draw titles of figure and panels. In print, captions replace them.
    pub titles: bool,
    /// Width of the charts.
    pub width: Width,
}

impl Default for ChartFormat {
    fn default() -> Self {
        Self { titles: true, width: Width::Page }
    }
}

/// Width of a chart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Width {
    /// 1280 px, for a screen.
    #[default]
    Page,
    /// One column of a journal, 85 mm, with the panels stacked.
    Single,
    /// Both columns of a journal, 178 mm.
    Double,
}

impl Width {
    /// Width in print in mm; `None` for a screen.
    pub fn mm(self) -> Option<f64> {
        match self {
            Self::Page => None,
            Self::Single => Some(85.0),
            Self::Double => Some(178.0),
        }
    }

    /// PNG pixels per SVG pixel (96 per inch): 144 per inch on a screen, 300 in print.
    pub(super) fn zoom(self) -> f32 {
        if self == Self::Page { 1.5 } else { 300.0 / 96.0 }
    }
}

impl FromStr for Width {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "page" => Ok(Self::Page),
            "single" => Ok(Self::Single),
            "double" => Ok(Self::Double),
            _ => Err(format!("found {text:?}; give page, single or double")),
        }
    }
}
