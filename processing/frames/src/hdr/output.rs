//! Maps and pictures of a merged bracket.

use super::merge::Sums;
use super::report::Samples;
use nacre_base::Result;
use nacre_image::{Attribute, OutputFolder, write_exr, write_png8};
use nacre_optics::color::srgb_code;
use rayon::prelude::*;

/// Number of standard deviations above zero below which light counts as dark.
const DARK_SIGMA: f32 = 3.0;

/// Values of `flags.exr`.
const SATURATED: f32 = 1.0;
const DARK: f32 = 2.0;

/// Brightness of the logarithmic mean in the picture, relative to white.
const KEY: f32 = 0.18;

/// Maximum number of samples for medians.
const LOOKED_AT: usize = 1 << 20;

/// Merged light of an image.
pub(super) struct Merged<'a> {
    pub sums: &'a Sums,
    pub width: usize,
    pub height: usize,
}

/// Statistics of merged light.
pub(super) struct Numbers {
    pub samples: Samples,
    pub sigma: Option<f64>,
    pub range: Option<f64>,
}

impl Merged<'_> {
    /// Names of the channels.
    pub(super) fn names(&self) -> &'static [&'static str] {
        if self.sums.channels() == 3 { &["R", "G", "B"] } else { &["Y"] }
    }

    /// Light, its variance, and its flag.
    fn at(&self, pixel: usize, channel: usize) -> [f32; 3] {
        match self.sums.at(pixel, channel) {
            None => [f32::NAN, f32::NAN, SATURATED],
            Some([light, variance]) => {
                let dark = light < DARK_SIGMA * variance.sqrt();
                [light, variance, if dark { DARK } else { 0.0 }]
            }
        }
    }

    /// Writes `hdr.exr`, `variance.exr`, `flags.exr` and `hdr.png`.
    pub(super) fn write(&self, folder: &OutputFolder) -> Result<()> {
        let files = [
            ("hdr.exr", "linear value / (exposure s * gain); NaN where saturated in every exposure"),
            ("variance.exr", "square of the unit of hdr.exr"),
            ("flags.exr", "0 measured, 1 saturated in every exposure, 2 dark in every exposure"),
        ];
        for (k, (name, units)) in files.into_iter().enumerate() {
            let attributes = [("units", Attribute::Text(units.into()))];
            write_exr(&folder.path(name), self.width, self.height, self.names(), &attributes, &|c, y, row| {
                row.iter_mut().enumerate().for_each(|(x, out)| *out = self.at(y * self.width + x, c)[k]);
            })?;
            folder.sync(name)?;
        }
        let channels = self.sums.channels();
        write_png8(&folder.path("hdr.png"), self.width, self.height, channels, &self.picture())
    }

    /// Picture in sRGB: Reinhard's global tone curve of the luminance (Reinhard et al. 2002, Eq. 4). Pixels saturated
    /// in all exposures are white.
    fn picture(&self) -> Vec<u8> {
        let channels = self.sums.channels();
        let pixel = |p: usize| -> [f32; 3] { std::array::from_fn(|c| self.at(p, c.min(channels - 1))[0]) };
        let luminance = |[r, g, b]: [f32; 3]| 0.2126 * r + 0.7152 * g + 0.0722 * b;
        let step = (self.sums.pixels() / LOOKED_AT).max(1);
        let mut light: Vec<f32> = (0..self.sums.pixels()).step_by(step).map(|p| luminance(pixel(p))).collect();
        light.retain(|l| *l > 0.0);
        light.sort_by(f32::total_cmp);
        let mean = (light.iter().map(|l| f64::from(l.ln())).sum::<f64>() / light.len().max(1) as f64).exp() as f32;
        let scale = KEY / mean.max(f32::MIN_POSITIVE);
        let white = light.get(light.len() * 995 / 1000).map_or(1.0, |l| (l * scale).max(1.0));
        let shown = |value: f32, luminance: f32| {
            let l = (luminance * scale).max(0.0);
            let curve = scale * (1.0 + l / (white * white)) / (1.0 + l);
            if value.is_nan() { 255 } else { srgb_code(value * curve) }
        };
        let mut bytes = vec![0_u8; self.sums.pixels() * channels];
        bytes.par_chunks_mut(channels).enumerate().for_each(|(p, out)| {
            let values = pixel(p);
            // A saturated channel is at least as bright as the others.
            let known = values.iter().copied().filter(|v| v.is_finite()).fold(0.0, f32::max);
            let l = luminance(values.map(|v| if v.is_nan() { known } else { v }));
            out.iter_mut().zip(values).for_each(|(out, value)| *out = shown(value, l));
        });
        bytes
    }

    /// Counts and medians.
    pub(super) fn numbers(&self) -> Numbers {
        let channels = self.sums.channels();
        let all = self.sums.pixels() * channels;
        let flags =
            |flag: f32| (0..all).into_par_iter().filter(|i| self.at(i / channels, i % channels)[2] == flag).count();
        let samples = Samples { all, saturated: flags(SATURATED), dark: flags(DARK) };
        let step = (all / LOOKED_AT).max(1);
        let measured = (0..all).step_by(step).map(|i| self.at(i / channels, i % channels)).filter(|v| v[2] == 0.0);
        let (mut light, mut sigma): (Vec<f32>, Vec<f32>) =
            measured.map(|[light, variance, _]| (light, variance.sqrt() / light)).unzip();
        light.sort_by(f32::total_cmp);
        sigma.sort_by(f32::total_cmp);
        let at =
            |v: &[f32], share: f64| v.get((share * v.len().saturating_sub(1) as f64) as usize).copied().map(f64::from);
        let range = at(&light, 0.999).zip(at(&light, 0.001)).map(|(high, low)| high / low);
        Numbers { samples, sigma: at(&sigma, 0.5), range }
    }
}
