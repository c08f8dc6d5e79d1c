//! `nacre reconstruct polarization`.

use crate::commands::Estimating;
use crate::commands::said::{lines, meets};
use crate::commands::values::PictureArgs;
use crate::console::Console;
use nacre_capture::Failure;
use nacre_polarimetry::{
    Align, AngleSource, Demosaic, ErrorReport, Metal, Model, Oblique, Options, PeriodMethod, PeriodReport, Report,
    SensorReport, Smoothing,
};
use std::fmt::Write;
use std::path::PathBuf;

/// Arguments of `nacre reconstruct polarization`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre reconstruct polarization session --out result
  nacre reconstruct polarization series/frames.json --out result --force --json
  nacre reconstruct polarization series --out result --model auto
  nacre reconstruct polarization sensor --out result --demosaic edge-aware
  nacre reconstruct polarization session --out result --offset-deg 12.5 --smooth strong
  nacre reconstruct polarization session --out result --contrast-period 1.2,3 --depth-um 0.1
  nacre reconstruct polarization session --out result --relative-period 0.7,2

The model plain writes stokes.exr (S0 S1 S2), aolp.exr (aolp dolp sigma sigma_dolp mask
correlation), aolp.png, dolp.png, sigma.png and report.json. Models of gratings write
orientation.exr (orientation sigma mask correlation) and orientation.png (smoothed) in place of
aolp.png; with periods also period.exr (period sigma mask) and period.png. Orientations are
relative: one unknown offset, common to all pixels, remains.")]
pub struct Polarization {
    /// Session folder, frames.json, or a folder holding one (`nacre import` makes one for your photographs).
    input: PathBuf,
    /// Folder for the results.
    #[arg(long)]
    out: PathBuf,
    /// plain, or how the fitted phase becomes the orientation of a grating [default: auto for capture sessions, plain for other
    /// photographs].
    ///
    /// plain: Stokes parameters, angle and degree of linear polarization. auto takes the simplest of the models of gratings that explains
    /// the data; sinusoid: the phase is the orientation; prenormalized: the phase about the mean of all pixels; circle: the phase about the
    /// centre of the circle that they lie on; curve: the nearest place on the curve of the fitted film.
    #[arg(long, value_name = "MODEL")]
    model: Option<Model>,
    /// auto moves photographs that are shifted against each other back, where that is worth it; off leaves them [default: auto for models
    /// of gratings, off for plain].
    #[arg(long, value_name = "auto|off")]
    align: Option<Align>,
    /// auto takes out what oblique incidence does, where the photographs say where the camera stood and fit better with
    /// it; off leaves it, and σ holds it.
    #[arg(long, default_value = "off", value_name = "auto|off")]
    oblique: Oblique,
    /// Maps of a monochrome polarization sensor in full size: how images behind each polarizer are interpolated (model plain).
    ///
    /// none: one map pixel per 2×2 super-pixel, the fastest and least noisy. bilinear: means of the nearest pixels. edge-aware:
    /// along edges, by Newton polynomials of the difference between polarizers (Li et al. 2019).
    #[arg(long, default_value = "none", value_name = "none|bilinear|edge-aware")]
    demosaic: Demosaic,
    /// Degrees added to every orientation, where one is known.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    offset_deg: f64,
    /// How orientations are smoothed in pictures.
    ///
    /// none, light (10 rounds of a bilateral filter), strong (50), or a number of rounds. orientation.exr stays as measured.
    #[arg(long, default_value = "light", value_name = "STRENGTH")]
    smooth: Smoothing,
    /// Smooth orientation.exr and its σ as well.
    #[arg(long)]
    smooth_maps: bool,
    /// Heuristic periods from the brightness, scaled to MIN,MAX µm.
    ///
    /// As the 2018 paper does; only their order has a meaning, and any unevenness of light or reflectance shows as a period.
    #[arg(long, value_name = "MIN,MAX", value_parser = range, conflicts_with = "contrast_period")]
    relative_period: Option<[f64; 2]>,
    /// Periods from the degree of polarization, which are known to lie within MIN,MAX µm, for an assumed surface.
    ///
    /// Off by 11 to 18 % for every 10 % that the depth is off.
    #[arg(long, value_name = "MIN,MAX", value_parser = range, requires = "depth_um")]
    contrast_period: Option<[f64; 2]>,
    /// Assumed depth of the grating, peak to peak, in µm.
    #[arg(long, value_name = "UM", requires = "contrast_period", conflicts_with = "relative_period")]
    depth_um: Option<f64>,
    /// Assumed metal: aluminium, silver, gold, chromium (near 560 nm), or its refractive index N,K.
    #[arg(long, default_value = "aluminium", requires = "contrast_period", conflicts_with = "relative_period")]
    metal: Metal,
    /// Assumed refractive index of what lies on the metal.
    #[arg(
        long,
        default_value_t = 1.0,
        value_name = "N",
        requires = "contrast_period",
        conflicts_with = "relative_period"
    )]
    index_above: f64,
    /// Wavelength in nm, where the photographs do not say theirs.
    #[arg(long, value_name = "NM", requires = "contrast_period", conflicts_with = "relative_period")]
    wavelength_nm: Option<f64>,
    /// Largest acceptable error of a typical orientation in degrees, noise and model together; the results are
    /// written in any case, but the exit code is 1 when the estimate is larger or cannot be made.
    #[arg(long, value_name = "DEG")]
    max_error: Option<f64>,
    /// Also write smoothed.exr: the smoothed orientations at full size.
    #[arg(long)]
    smoothed_exr: bool,
    #[command(flatten)]
    pictures: PictureArgs,
    /// Replace results that are already in the folder.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    estimating: Estimating,
}

impl Polarization {
    /// Runs the reconstruction.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        let options = Options {
            model: self.model,
            align: self.align,
            oblique: self.oblique,
            demosaic: self.demosaic,
            offset_deg: self.offset_deg,
            smooth: self.smooth,
            smooth_maps: self.smooth_maps,
            smoothed_exr: self.smoothed_exr,
            period: self.period(),
            palette: self.pictures.palette,
            no_scale_bar: self.pictures.bar.no_scale_bar,
            overwrite: self.force,
        };
        let report = nacre_polarimetry::reconstruct(&self.input, &self.out, &options, console)?;
        let mut text = summary(&report);
        let _ = write!(text, "\nresults   {}", self.out.display());
        console.result(&text, &report);
        let remedy = "add analyser angles, expose longer, or heed the warnings";
        meets(self.max_error, report.error_estimate_deg, ["the estimated error", "°", remedy])
    }

    fn period(&self) -> Option<PeriodMethod> {
        if let Some(range_um) = self.relative_period {
            return Some(PeriodMethod::Brightness { range_um });
        }
        Some(PeriodMethod::Contrast {
            range_um: self.contrast_period?,
            depth_um: self.depth_um?,
            metal: self.metal,
            index_above: self.index_above,
            wavelength_nm: self.wavelength_nm,
        })
    }
}

/// Two numbers with a comma between them.
fn range(text: &str) -> Result<[f64; 2], String> {
    let two = text.split_once(',').and_then(|(a, b)| Some([a.trim().parse().ok()?, b.trim().parse().ok()?]));
    two.ok_or_else(|| format!("found {text:?}; give two numbers of µm such as 0.7,2"))
}

/// The report in a few lines.
pub fn summary(report: &Report) -> String {
    let pixels = &report.pixels;
    let percent = |n: usize| 100.0 * n as f64 / pixels.all.max(1) as f64;
    let mut text = format!(
        "frames    {} photograph{}, {} × {} pixels\nmodel     {} ({})\n",
        report.frames.len(),
        if report.frames.len() == 1 { "" } else { "s" },
        report.width,
        report.height,
        report.model,
        report.model_reason
    );
    if let Some(sensor) = &report.sensor {
        let _ = writeln!(text, "sensor    {}", map_pixel(sensor));
    }
    let plain = report.model == Model::Plain.word();
    let carry = if plain { "have an angle of polarization" } else { "carry an orientation" };
    let bare = |n: usize| if plain { String::new() } else { format!("{:.1} % metal without a grating, ", percent(n)) };
    let _ = writeln!(
        text,
        "pixels    {:.1} % {carry}; masked: {:.1} % too little modulation, {}{:.1} % saturated",
        percent(pixels.valid),
        percent(pixels.too_little_modulation),
        bare(pixels.without_grating),
        percent(pixels.saturated)
    );
    if let Some(estimate) = report.error_estimate_deg {
        let _ = writeln!(text, "estimate  expected error of a typical pixel: {estimate:.3}° (all known terms)");
    }
    let _ = writeln!(text, "error     {}", terms(&report.error));
    if let Some(repeats) = &report.repeats {
        let _ = writeln!(
            text,
            "repeats   {} pairs: their halves differ by {:.3}° where σ says {:.3}° (reduced χ² {:.2})",
            repeats.pairs, repeats.difference_deg, repeats.expected_deg, repeats.chi2
        );
    }
    if let (Some(median), Some(p90), Some(correlation)) =
        (pixels.sigma_median_deg, pixels.sigma_p90_deg, pixels.correlation_mean)
    {
        let _ = writeln!(
            text,
            "quality   σ median {median:.3}°, 90 % under {p90:.3}° (noise {}); correlation of the fit {correlation:.3}",
            serde_json::to_value(report.noise.source)
                .ok()
                .and_then(|v| v.as_str().map(str::to_owned))
                .unwrap_or_default()
        );
    }
    if let Some(period) = &report.period {
        let _ = writeln!(text, "periods   {}", periods(period));
    }
    text += &lines(&[], &report.warnings);
    let s = &report.seconds;
    let _ = write!(
        text,
        "time      {:.2} s: reading and fitting {:.2}, solving {:.2}, writing {:.2}",
        s.total, s.read_and_fit, s.solve, s.write
    );
    text
}

/// Number of sensor pixels behind each map pixel, in words.
fn map_pixel(sensor: &SensorReport) -> String {
    let side = sensor.map_pixel_px;
    match (sensor.demosaic, sensor.channel) {
        (Demosaic::None, None) => format!("one map pixel per {side} × {side} pixels"),
        (Demosaic::None, Some(channel)) => format!("one map pixel per {side} × {side} pixels, {}", channel.name()),
        (Demosaic::Bilinear, _) => "one map pixel per pixel, by bilinear interpolation".into(),
        (Demosaic::EdgeAware, _) => "one map pixel per pixel, by edge-aware interpolation".into(),
    }
}

/// What the error is made of.
fn terms(error: &ErrorReport) -> String {
    let term = |name: &str, deg: Option<f64>| deg.map_or(format!("{name} unknown"), |v| format!("{name} {v:.3}°"));
    let off = error.angle_sigma_deg.map_or(String::new(), |v| match error.angle_source {
        Some(AngleSource::Corrected) => format!(" (corrected to {v:.3}°)"),
        _ => format!(" (error of an angle {v:.3}°)"),
    });
    let angles = term("analyser angles", error.angle_deg) + &off;
    let rest = [term("registration", error.registration_deg), term("model", error.model_deg)].join(", ");
    format!("{}, {angles}, {rest}", term("noise", error.noise_deg))
}

fn periods(period: &PeriodReport) -> String {
    let Some(median) = period.median_um else { return "none found".into() };
    let kind = if period.heuristic { "heuristic, from brightness" } else { "from contrast, for the assumed surface" };
    let sigma = period.sigma_median_um.map_or(String::new(), |s| format!(" ± {s:.4} µm from noise"));
    format!("median {median:.3} µm{sigma} ({kind}); {} pixels have none", period.ambiguous)
}
