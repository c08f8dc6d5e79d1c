//! Text summary of a calibration.

use super::band::Band;
use super::report::Report;
use nacre_base::operation::lines;
use nacre_optics::geometry::Geometry;
use std::fmt::Write;

/// Lines about camera, sample, display and light, with their uncertainties.
pub fn summary(g: &Geometry, report: &Report, band: Option<Band>) -> String {
    let mut text = String::new();
    let sigma = |s: Option<f64>| s.map_or(" (σ unknown)".into(), |s| format!(" ± {s:.3}"));
    if let Some(rms) = report.rms_px {
        let used = report.photographs.iter().filter(|p| p.rms_px.is_some()).count();
        let _ = writeln!(text, "boards    {used} of {} photographs, {rms:.3} px RMS", report.photographs.len());
    }
    for p in &report.photographs {
        if let Some(why) = &p.unused_because {
            let _ = writeln!(text, "not used  {} {why}", p.file);
        }
    }
    let (f, fs, c, cs) = (g.camera.focal_px, g.sigma.focal_px, g.camera.center_px, g.sigma.center_px);
    let _ = writeln!(
        text,
        "camera    focal length {:.2}{}, {:.2}{} px; axis at {:.2}{}, {:.2}{} px",
        f[0],
        sigma(fs.map(|s| s[0])),
        f[1],
        sigma(fs.map(|s| s[1])),
        c[0],
        sigma(cs.map(|s| s[0])),
        c[1],
        sigma(cs.map(|s| s[1])),
    );
    let [x, y, z] = g.viewer();
    let _ = writeln!(text, "viewer    {x:.2}, {y:.2}, {z:.2} mm from the middle of the sample");
    let triple = |v: [f64; 3], s: Option<[f64; 3]>| {
        let one = |k: usize| format!("{:.2}{}", v[k], sigma(s.map(|s| s[k])));
        format!("{}, {}, {} mm", one(0), one(1), one(2))
    };
    if let Some(panel) = &g.panel {
        let _ = writeln!(text, "panel     middle at {}", triple(panel.pose.translation_mm, g.sigma.panel_mm));
    }
    if let Some(light) = g.light_mm {
        let _ = writeln!(text, "light     {}", triple(light, g.sigma.light_mm));
    }
    if let Some(nm) = g.wavelength_nm {
        let _ = writeln!(text, "light     {nm:.2}{} nm", sigma(g.sigma.wavelength_nm));
    }
    if let Some(band) = band {
        let _ = writeln!(text, "band      {:.2} nm wide at half maximum, {:.2} nm RMS", band.fwhm_nm, band.spread_nm);
    }
    text += &lines(&[], &report.warnings);
    text.trim_end().to_owned()
}
