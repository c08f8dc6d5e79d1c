//! Short summary of a report.

use crate::{AngleSource, Demosaic, ErrorReport, Model, PeriodReport, Report, SensorReport};
use nacre_base::operation::{Summary, lines};
use nacre_frames::Calibration;
use std::fmt::Write;

impl Summary for Report {
    fn summary(&self) -> String {
        let pixels = &self.pixels;
        let percent = |n: usize| 100.0 * n as f64 / pixels.all.max(1) as f64;
        let mut text = format!(
            "frames    {} photograph{}, {} × {} pixels\nmodel     {} ({})\n",
            self.frames.len(),
            if self.frames.len() == 1 { "" } else { "s" },
            self.width,
            self.height,
            self.model,
            self.model_reason
        );
        if let Some(sensor) = &self.sensor {
            let _ = writeln!(text, "sensor    {}", map_pixel(sensor));
        }
        let plain = self.model == Model::Plain.word();
        let carry = if plain { "have an angle of polarization" } else { "carry an orientation" };
        let bare =
            |n: usize| if plain { String::new() } else { format!("{:.1} % metal without a grating, ", percent(n)) };
        let _ = writeln!(
            text,
            "pixels    {:.1} % {carry}; masked: {:.1} % too little modulation, {}{:.1} % saturated",
            percent(pixels.valid),
            percent(pixels.too_little_modulation),
            bare(pixels.without_grating),
            percent(pixels.saturated)
        );
        if let Some(estimate) = self.error_estimate_deg {
            let _ = writeln!(text, "estimate  expected error of a typical pixel: {estimate:.3}° (all known terms)");
        }
        let _ = writeln!(text, "error     {}", terms(&self.error));
        if let Some(calibration) = &self.calibration {
            let _ = writeln!(text, "calibr.   {}", applied(calibration, self.absolute_error_deg));
        }
        if let Some(repeats) = &self.repeats {
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
                serde_json::to_value(self.noise.source)
                    .ok()
                    .and_then(|v| v.as_str().map(str::to_owned))
                    .unwrap_or_default()
            );
        }
        if let Some(period) = &self.period {
            let _ = writeln!(text, "periods   {}", periods(period));
        }
        text += &lines(&[], &self.warnings);
        let s = &self.seconds;
        let _ = write!(
            text,
            "time      {:.2} s: reading and fitting {:.2}, solving {:.2}, writing {:.2}",
            s.total, s.read_and_fit, s.solve, s.write
        );
        text
    }
    fn warnings(&self) -> &[String] {
        &self.warnings
    }
}

/// Number of sensor pixels behind each map pixel, as text.
fn map_pixel(sensor: &SensorReport) -> String {
    let side = sensor.map_pixel_px;
    match (sensor.demosaic, sensor.channel) {
        (Demosaic::None, None) => format!("one map pixel per {side} × {side} pixels"),
        (Demosaic::None, Some(channel)) => format!("one map pixel per {side} × {side} pixels, {}", channel.name()),
        (Demosaic::Bilinear, _) => "one map pixel per pixel, by bilinear interpolation".into(),
        (Demosaic::EdgeAware, _) => "one map pixel per pixel, by edge-aware interpolation".into(),
    }
}

/// Terms of the error.
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

/// Sentence about the calibrations that were applied.
fn applied(calibration: &Calibration, absolute_deg: Option<f64>) -> String {
    let mut parts = vec![];
    if let Some(a) = &calibration.analyser {
        parts.push(format!("analyser (zero {:.3}° ± {:.3}°)", a.zero_deg, a.zero_sigma_deg));
    }
    if let Some(r) = &calibration.retarder {
        parts.push(format!("retarder ({:.2}° at {:.2}°)", r.retardance_deg, r.azimuth_deg));
    }
    for (name, given) in [("camera", calibration.camera.is_some()), ("flat field", calibration.flat.is_some())] {
        parts.extend(given.then(|| name.to_owned()));
    }
    if let Some(o) = &calibration.orientation {
        parts.push(format!("offset ({:.3}° ± {:.3}°)", o.offset_deg, o.sigma_deg));
    }
    let absolute = absolute_deg.map_or(String::new(), |deg| format!("; error of absolute orientations: {deg:.3}°"));
    if parts.is_empty() { "none".into() } else { format!("{}{absolute}", parts.join(", ")) }
}
