//! Reconstruction of a lookup table: table, pictures and report in a new folder.

use super::input::{Input, light, named, photograph};
use super::lookup::{Table, lookup};
use super::output::Output;
use super::report::{Report, Seconds};
use super::settings::{Settings, Wavelength};
use nacre_base::Result;
use nacre_base::operation::perform;
use nacre_base::progress::Progress;
use nacre_image::OutputFolder;
use std::path::Path;
use std::time::Instant;

/// Fraction of partly covered entries above which a warning is issued.
const UNCOVERED: f64 = 0.05;

/// Computes a table from `input` (a photograph, merged exposures, or a series of exposures to merge first) in the new
/// folder `out`.
///
/// # Errors
/// `Input` for an invalid photograph or option, before anything is written. `Output` if writing fails; the partial
/// folder is then removed. `Cancelled`.
pub fn reconstruct(input: &Path, out: &Path, settings: &Settings, progress: &dyn Progress) -> Result<Report> {
    perform(settings, input, out, false, progress)
}

/// Computes a table in a folder.
///
/// Memory: 16 bytes per entry, at most 2 GB for an octave of radii, and three copies of the photograph. A photograph of
/// the light adds 20 bytes per entry.
pub(super) fn table_into(
    folder: &OutputFolder,
    input: &Path,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Report> {
    let begun = Instant::now();
    progress.stage("reading", 1);
    let Input { channels, settings, band_nm, merged, warnings: mut of_files } = photograph(input, settings, progress)?;
    let read = begun.elapsed().as_secs_f64();
    progress.check()?;
    progress.stage("adding up wavelengths", 1);
    let mut table = lookup(&channels, &settings)?;
    if let Some(photograph) = &settings.light {
        let (light, of_light) = light(photograph, &settings, table.scale, progress)?;
        of_files.extend(of_light);
        table.spread(&light).map_err(|e| named(&photograph.path, e))?;
    }
    let added = begun.elapsed().as_secs_f64();
    progress.step();
    progress.check()?;
    progress.stage("writing", 1);
    let output = Output { table: &table, settings: &settings };
    output.write(folder)?;
    let wavelength_nm = settings.bands()?;
    let mut report = Report {
        method: "lut",
        warnings: vec![],
        assumptions: vec![],
        width: settings.size,
        height: settings.size,
        extent: table.extent,
        warp: settings.warp,
        wavelength_nm,
        illuminant: settings.illuminant.clone(),
        observer: settings.observer,
        exponent: settings.exponent,
        scale: table.scale,
        center: table.center,
        center_sigma_px: table.center_sigma_px,
        choice: table.choice.clone(),
        error_estimate: table.whole_error(),
        sum_error: table.error,
        sampling_error: table.sampling_error,
        center_error: table.center_error,
        light: table.light,
        band_px: band_nm.zip(narrow(wavelength_nm)).map(|(band, nm)| band / nm * table.extent / table.scale),
        coverage: output.coverage(),
        merged,
        seconds: Seconds::default(),
    };
    report.warnings = of_files;
    report.warnings.extend(warnings(&report, &table, settings.max_error));
    report.assumptions = assumptions(&report, &settings);
    let total = begun.elapsed().as_secs_f64();
    report.seconds = Seconds { read, table: added - read, write: total - added, total };
    progress.step();
    Ok(report)
}

fn narrow(wavelength: Wavelength) -> Option<f64> {
    match wavelength {
        Wavelength::Band(nm) => Some(nm),
        Wavelength::Channels(_) => None,
    }
}

/// Assumptions that a photograph cannot verify, each with an example of its effect. The examples stem from the studies
/// `lut-depth`, `lut-wavelength` and `lut-tilt`, with orders at the rim two pixels wide and some seventy from the zero
/// order.
fn assumptions(report: &Report, settings: &Settings) -> Vec<String> {
    let mut all = vec![];
    match (report.wavelength_nm, settings.exponent) {
        (Wavelength::Band(_), 4.0) => all.push(
            "orders grow weaker with the fourth power of the wavelength, as first orders of shallow gratings do (in an example 1 % off at \
             20 nm of depth, 6 % at 40, 26 % at 80); three bands bear any depth"
                .into(),
        ),
        (Wavelength::Band(_), n) => all.push(format!("orders grow weaker with the power {n} of the wavelength")),
        (Wavelength::Channels(_), _) => all.push(
            "red, green and blue were photographed in three narrow bands; a colour photograph in white light blurs orders (in an example \
             12 % off and more)"
                .into(),
        ),
    }
    all.push(
        "the wavelength of the photograph is right (in an example 1 nm moves the rim by 1.3 % of its light)".into(),
    );
    all.push("the surface faces the camera (in an example 0.2° of tilt are 1.4 % off, 1° 7 %)".into());
    if report.light.is_none() {
        all.push("the light to come is a point; --light takes a photograph of one that is not".into());
    }
    all
}

fn warnings(report: &Report, table: &Table, wanted: f64) -> Vec<String> {
    let mut all = vec![];
    let [x, y] = table.center;
    if let Some([lx, ly]) = table.lobe {
        all.push(format!(
            "the zero order was said to be at {x:.2}, {y:.2}, but the lobe there lies at {lx:.2}, {ly:.2}"
        ));
    }
    if let Some(([rx, ry], share)) = table.rival {
        all.push(format!(
            "the brightest lobe, at {x:.1}, {y:.1}, was taken for the zero order, but what is at {rx:.0}, {ry:.0} is {:.0} % as \
             bright; if that is it, say so with --center",
            100.0 * share
        ));
    }
    if table.saturated {
        all.push("the zero order is saturated: entries near to the middle are unknown (see coverage)".into());
    }
    match report.center_error {
        Some(error) if error > wanted => {
            let off = table.center_sigma_px.unwrap_or(0.0);
            all.push(format!(
                "the zero order is only known to {off:.2} pixels, which moves the rim by {:.1} %",
                100.0 * error
            ));
        }
        _ if table.center_sigma_px.is_none() => {
            all.push("nothing tells whether the zero order is where it was said to be".into());
        }
        _ => {}
    }
    match report.error_estimate {
        None => all.push("no light was measured at the rim of the table".into()),
        Some(error) if error > wanted => {
            let light = report.light.and_then(|l| l.error);
            let parts = [report.sum_error, report.center_error, report.sampling_error, light];
            let parts = parts.map(|e| 100.0 * e.unwrap_or(0.0));
            let spread = light.map_or(String::new(), |_| {
                format!("; between entries, where the light's points fall, {:.2} %", parts[3])
            });
            all.push(format!(
                "the error at the rim is {:.2} %, more than the {:.2} % asked for: adding up {:.2} %, place of the zero order {:.2} %, \
                 pixels too coarse for what they show, or noise, {:.2} %{spread}",
                100.0 * error,
                100.0 * wanted,
                parts[0],
                parts[1],
                parts[2]
            ));
        }
        Some(_) => {}
    }
    if 1.0 - report.coverage.full > UNCOVERED {
        let part = 100.0 * (1.0 - report.coverage.full);
        all.push(format!(
            "{part:.0} % of the entries were measured in part only ({:.0} % not at all): the photograph ends before the half vectors \
             that short wavelengths need; see coverage, or choose a smaller extent",
            100.0 * report.coverage.none
        ));
    }
    all
}
