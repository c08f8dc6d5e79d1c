//! Values as the command line says them.

use clap::ValueEnum;
use nacre_frames::{Bayer, Channel, Transfer};
use nacre_image::Palette;

/// How pictures of maps are drawn.
#[derive(Clone, Copy, clap::Args)]
pub(in crate::commands) struct PictureArgs {
    /// Colours of angles in pictures: cyclic (even steps, also for colour-blind readers) or hsv.
    #[arg(long, default_value = "cyclic", value_name = "cyclic|hsv")]
    pub palette: Palette,
    #[command(flatten)]
    pub bar: BarArgs,
}

/// Whether pictures have a scale bar.
#[derive(Clone, Copy, clap::Args)]
pub(in crate::commands) struct BarArgs {
    /// Leave the scale bar out of pictures. They have one where the pixel size on the sample is known.
    #[arg(long)]
    pub no_scale_bar: bool,
}

/// As many numbers as wanted, with commas.
pub(in crate::commands) fn numbers<T: std::str::FromStr, const N: usize>(
    text: &str,
    wanted: &str,
) -> Result<[T; N], String> {
    let all: Result<Vec<T>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    all.ok().and_then(|all| all.try_into().ok()).ok_or_else(|| format!("give {wanted}"))
}

/// How values grow with light.
pub(super) fn transfer(text: &str) -> Result<Transfer, String> {
    match (text, text.strip_prefix("gamma=").map(str::parse)) {
        ("linear", _) => Ok(Transfer::Linear),
        ("srgb", _) => Ok(Transfer::Srgb),
        ("recover", _) => Ok(Transfer::Recover),
        (_, Some(Ok(g))) => Ok(Transfer::Gamma(g)),
        _ => Err("give linear, srgb, gamma=NUMBER or recover".into()),
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

/// A channel of a colour file.
#[derive(Clone, Copy, ValueEnum)]
pub(super) enum ChannelName {
    R,
    G,
    B,
    /// The mean of a colour polarization sensor's filters, or channel Y of an EXR file.
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
