//! Polarizers and colour filters on the pixels of polarization sensors.

use super::{Channel, FrameSet};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Analyser angles of each 2×2 block of a polarization sensor, by name or as numbers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "layout is no name of a sensor (sony, sony-colour, lucid, lucid-colour, flir, flir-colour, 4d-v1, 4d-v2, \
                 4d-u4) and not [[top left, top right], [bottom left, bottom right]] in degrees"
)]
pub enum Layout {
    /// By the sensor's or the camera's name.
    Named(Sensor),
    /// In degrees, `[[top left, top right], [bottom left, bottom right]]`.
    Angles([[f64; 2]; 2]),
}

/// Sensors and cameras with polarizers on their pixels. docs/reference/photographs.md names the source of each order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Sensor {
    /// Sony IMX250MZR, IMX253MZR and IMX264MZR.
    Sony,
    /// Sony IMX250MYR, IMX253MYR and IMX264MYR: colour filters over 2×2 polarizers each.
    SonyColour,
    /// Lucid Phoenix PHX050S-P and Triton TRI050S-P (Sony sensors).
    Lucid,
    /// Lucid Phoenix PHX050S-Q and Triton TRI050S-Q (Sony colour sensors).
    LucidColour,
    /// FLIR Blackfly S BFS-U3-51S5P and BFS-PGE-51S5P (Sony sensors).
    Flir,
    /// FLIR Blackfly S BFS-U3-51S5PC and BFS-PGE-51S5PC (Sony colour sensors).
    FlirColour,
    /// 4D Technology PolarCam, first version.
    #[serde(rename = "4d-v1")]
    FourDV1,
    /// 4D Technology PolarCam, second version.
    #[serde(rename = "4d-v2")]
    FourDV2,
    /// 4D Technology PolarCam U4.
    #[serde(rename = "4d-u4")]
    FourDU4,
}

/// Colour filters of each 4×4 super-pixel, row by row; each colour covers 2×2 polarizers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Bayer {
    /// Red, green; green, blue.
    Rggb,
    /// Blue, green; green, red.
    Bggr,
    /// Green, red; blue, green.
    Grbg,
    /// Green, blue; red, green.
    Gbrg,
}

/// Filters of a polarization sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Filters {
    /// Analyser angles of a 2×2 block in degrees, row by row.
    pub angles: [f64; 4],
    /// Colours of a 4×4 super-pixel; `None` for monochrome sensors.
    pub colour: Option<Bayer>,
}

impl Sensor {
    /// All sensors, by name.
    pub const NAMES: [(&str, Self); 9] = [
        ("sony", Self::Sony),
        ("sony-colour", Self::SonyColour),
        ("lucid", Self::Lucid),
        ("lucid-colour", Self::LucidColour),
        ("flir", Self::Flir),
        ("flir-colour", Self::FlirColour),
        ("4d-v1", Self::FourDV1),
        ("4d-v2", Self::FourDV2),
        ("4d-u4", Self::FourDU4),
    ];

    fn filters(self) -> Filters {
        let angles = match self {
            Self::FourDV1 => [45.0, 90.0, 0.0, 135.0],
            Self::FourDV2 => [90.0, 135.0, 45.0, 0.0],
            _ => [90.0, 45.0, 135.0, 0.0],
        };
        let colour = matches!(self, Self::SonyColour | Self::LucidColour | Self::FlirColour).then_some(Bayer::Rggb);
        Filters { angles, colour }
    }
}

impl std::str::FromStr for Layout {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Some((_, sensor)) = Sensor::NAMES.iter().find(|(name, _)| *name == text) {
            return Ok(Self::Named(*sensor));
        }
        let angles: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse()).collect();
        match angles.as_deref() {
            Ok(&[a, b, c, d]) => Ok(Self::Angles([[a, b], [c, d]])),
            _ => {
                let names = Sensor::NAMES.map(|(name, _)| name).join(", ");
                Err(format!("found {text:?}; give four angles, such as 90,45,135,0, or a name: {names}"))
            }
        }
    }
}

impl Bayer {
    /// Blocks of a channel among the four of a super-pixel, `(x, y)`; all four for the luminance.
    fn blocks(self, channel: Channel) -> Vec<[usize; 2]> {
        use Channel::{B, G, R};
        let colours = match self {
            Self::Rggb => [R, G, G, B],
            Self::Bggr => [B, G, G, R],
            Self::Grbg => [G, R, B, G],
            Self::Gbrg => [G, B, R, G],
        };
        let of_channel = |k: &usize| channel == Channel::Luminance || colours[*k] == channel;
        (0..4).filter(of_channel).map(|k| [k % 2, k / 2]).collect()
    }
}

impl Filters {
    /// Side of a super-pixel in pixels; maps have one pixel per super-pixel.
    pub fn block(&self) -> usize {
        if self.colour.is_some() { 4 } else { 2 }
    }

    /// Pixels of a super-pixel, `(x, y)`, behind the `k`-th analyser angle and the channel's colour (default: green).
    /// Their light is averaged.
    pub fn pixels(&self, k: usize, channel: Option<Channel>) -> Vec<[usize; 2]> {
        let blocks = self.colour.map_or_else(|| vec![[0, 0]], |c| c.blocks(channel.unwrap_or(Channel::G)));
        blocks.iter().map(|[x, y]| [2 * x + k % 2, 2 * y + k / 2]).collect()
    }
}

impl FrameSet {
    /// Filters on the sensor's pixels; `None` for photographs of other cameras.
    pub fn filters(&self) -> Option<Filters> {
        Some(match self.layout? {
            Layout::Named(sensor) => sensor.filters(),
            Layout::Angles([[a, b], [c, d]]) => Filters { angles: [a, b, c, d], colour: self.colour },
        })
    }

    /// Index of the file channel to read.
    pub fn file_channel(&self) -> usize {
        // The colours of a mosaic sensor are pixels of one channel.
        if self.layout.is_some() { 0 } else { self.channel.map_or(0, Channel::index) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_the_file_format() {
        for (name, sensor) in Sensor::NAMES {
            assert_eq!(serde_json::to_value(sensor).unwrap(), name);
            let layout: Layout = serde_json::from_value(name.into()).unwrap();
            assert_eq!((Ok(layout), layout), (name.parse(), Layout::Named(sensor)));
        }
        assert_eq!("0, 45,90,135".parse(), Ok(Layout::Angles([[0.0, 45.0], [90.0, 135.0]])));
        for wrong in ["", "0,45,90", "0,45,90,135,0", "nikon", "0,45,x,135"] {
            assert!(wrong.parse::<Layout>().unwrap_err().contains("sony-colour"), "{wrong}");
        }
        let refused = serde_json::from_str::<Layout>("\"nikon\"").unwrap_err().to_string();
        assert!(refused.contains("sony-colour"), "{refused}");
    }

    /// R 90, R 45, G 90, G 45; R 135, R 0, …: the raw frame of a colour sensor, as documented by its manufacturers.
    #[test]
    fn each_colour_covers_a_block_of_four_polarizers() {
        let filters = Sensor::SonyColour.filters();
        assert_eq!((filters.block(), filters.angles), (4, [90.0, 45.0, 135.0, 0.0]));
        assert_eq!(filters.pixels(1, Some(Channel::R)), [[1, 0]]);
        assert_eq!(filters.pixels(3, None), [[3, 1], [1, 3]], "both greens at 0°");
        assert_eq!(filters.pixels(2, Some(Channel::B)), [[2, 3]]);
        assert_eq!(filters.pixels(0, Some(Channel::Luminance)).len(), 4);
        for colour in [Bayer::Rggb, Bayer::Bggr, Bayer::Grbg, Bayer::Gbrg] {
            let filters = Filters { colour: Some(colour), ..filters };
            let of = |channel| (0..4).flat_map(move |k| filters.pixels(k, Some(channel)));
            let mut all: Vec<_> = [Channel::R, Channel::G, Channel::B].into_iter().flat_map(of).collect();
            all.sort_unstable();
            all.dedup();
            assert_eq!(all.len(), 16, "{colour:?} covers every pixel once");
        }
        assert_eq!(Filters { colour: None, ..filters }.pixels(3, None), [[1, 1]]);
    }
}
