//! Parsers of command-line values.

use clap::ValueEnum;
use nacre_frames::{Bayer, Channel, Transfer};
use nacre_image::Palette;

/// Options for pictures of maps.
#[derive(Clone, Copy, clap::Args)]
pub(in crate::commands) struct PictureArgs {
    /// Colour scale of angles in pictures: cyclic (perceptually even, safe for colour-blind readers) or hsv.
    #[arg(long, default_value = "cyclic", value_name = "cyclic|hsv")]
    pub palette: Palette,
    #[command(flatten)]
    pub bar: BarArgs,
}

/// Option for the scale bar in pictures.
#[derive(Clone, Copy, clap::Args)]
pub(in crate::commands) struct BarArgs {
    /// Omit the scale bar, which pictures with a known pixel size have.
    #[arg(long)]
    pub no_scale_bar: bool,
}

/// Parses exactly `N` comma-separated numbers.
pub(in crate::commands) fn numbers<T: std::str::FromStr, const N: usize>(
    text: &str,
    wanted: &str,
) -> Result<[T; N], String> {
    let all: Result<Vec<T>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    all.ok().and_then(|all| all.try_into().ok()).ok_or_else(|| format!("give {wanted}"))
}

/// Parses a transfer function.
pub(super) fn transfer(text: &str) -> Result<Transfer, String> {
    let wanted = || "give linear, srgb, gamma=NUMBER, polynomial=A,B,C or recover".to_owned();
    match text.split_once('=') {
        None if text == "linear" => Ok(Transfer::Linear),
        None if text == "srgb" => Ok(Transfer::Srgb),
        None if text == "recover" => Ok(Transfer::Recover),
        Some(("gamma", g)) => g.parse().map(Transfer::Gamma).map_err(|_| wanted()),
        Some(("polynomial", c)) => numbers(c, "three numbers").map(Transfer::Polynomial).map_err(|_| wanted()),
        _ => Err(wanted()),
    }
}

/// Colour filters of a sensor.
#[derive(Clone, Copy, ValueEnum)]
pub(super) enum BayerName {
    Rggb,
    Bggr,
    Grbg,
    Gbrg,
}

impl From<BayerName> for Bayer {
    fn from(name: BayerName) -> Self {
        match name {
            BayerName::Rggb => Self::Rggb,
            BayerName::Bggr => Self::Bggr,
            BayerName::Grbg => Self::Grbg,
            BayerName::Gbrg => Self::Gbrg,
        }
    }
}

/// Channel of a colour file.
#[derive(Clone, Copy, ValueEnum)]
pub(super) enum ChannelName {
    R,
    G,
    B,
    /// Mean of a colour polarization sensor's filters, or channel Y of an EXR file.
    Luminance,
}

impl From<ChannelName> for Channel {
    fn from(name: ChannelName) -> Self {
        match name {
            ChannelName::R => Self::R,
            ChannelName::G => Self::G,
            ChannelName::B => Self::B,
            ChannelName::Luminance => Self::Luminance,
        }
    }
}
