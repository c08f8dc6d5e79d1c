//! Values as the command line says them.

use clap::ValueEnum;
use nacre_frames::{Channel, Transfer};

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

/// A channel of a colour file.
#[derive(Clone, Copy, ValueEnum)]
pub(super) enum ChannelName {
    R,
    G,
    B,
}

impl From<ChannelName> for Channel {
    fn from(name: ChannelName) -> Self {
        match name {
            ChannelName::R => Self::R,
            ChannelName::G => Self::G,
            ChannelName::B => Self::B,
        }
    }
}
