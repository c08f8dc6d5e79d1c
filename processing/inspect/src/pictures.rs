//! Pictures of an inspection as data URIs.

use crate::inspection::Inspection;
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use nacre_image::{Canvas, MASKED, Palette, encode_png8, viridis};

/// Longest side of a picture in pixels; larger maps are thinned.
const LONGEST: usize = 900;

/// Shortest longest side: small maps are enlarged by whole factors.
const SHORTEST: usize = 420;

/// Colour of boxes around defects.
const BOX: [u8; 3] = [230, 40, 40];

/// Margin of a box in pixels of the map.
const MARGIN: f64 = 4.0;

/// A picture of a page.
pub struct Shown {
    /// Title.
    pub title: &'static str,
    /// Explanation of the colours.
    pub text: String,
    /// The picture as a data URI.
    pub uri: String,
}

/// Orientations of reference and sample, and the deviation, each with boxes around defects.
pub fn pictures(found: &Inspection) -> Vec<Shown> {
    let differences = &found.differences;
    let palette = Palette::default();
    let least = |i: usize| 3.0 * differences.sigma[i].min(0.2);
    let orientation = |of: num_complex::Complex32, i: usize| {
        let known = of.is_finite() && of.norm() > least(i);
        if known { palette.color(0.5 * of.arg()) } else { MASKED }
    };
    let top = (2.0 * found.threshold) as f32;
    let deviation = |i: usize| if differences.compared[i] { viridis(differences.statistic[i] / top) } else { MASKED };
    let angles = "Pale yellow 0°, blue 45°, near black 90°, brown 135°; grey where there is no grating.";
    let mut all = vec![
        shown(found, "Reference: orientation", angles.into(), &|i| orientation(differences.reference[i], i)),
        shown(found, "Sample, registered: orientation", angles.into(), &|i| orientation(differences.sample[i], i)),
        shown(
            found,
            "Deviation",
            format!(
                "Dark 0 to yellow {top:.0} standard deviations; threshold {:.2}. Grey: not compared.",
                found.threshold
            ),
            &deviation,
        ),
    ];
    if !differences.light.value.is_empty() {
        let light = |i: usize| {
            let v = differences.light.value[i];
            if v.is_finite() { viridis(0.5 + v) } else { MASKED }
        };
        let text = "Dark 0.6, green 1, yellow 1.6 times the reference, after a smooth background.".into();
        all.push(shown(found, "Brightness", text, &light));
    }
    all
}

fn shown(found: &Inspection, title: &'static str, text: String, color: &dyn Fn(usize) -> [u8; 3]) -> Shown {
    let (width, height) = (found.differences.width, found.differences.height);
    let longest = width.max(height);
    let (step, zoom) = (longest.div_ceil(LONGEST).max(1), (SHORTEST / longest.max(1)).clamp(1, 16));
    let (columns, rows) = (width.div_ceil(step), height.div_ceil(step));
    let mut canvas = Canvas::new(columns * zoom, rows * zoom, MASKED);
    for (x, y) in (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))) {
        canvas.rectangle(x * zoom, y * zoom, zoom, zoom, color(y * step * width + x * step));
    }
    let scale = zoom as f64 / step as f64;
    for defect in &found.regions.defects {
        let half = 0.5 * defect.size_px[0] + MARGIN;
        let [left, top] = defect.at_px.map(|v| ((v - half) * scale).max(0.0) as usize);
        let side = (2.0 * half * scale) as usize;
        for (x, y, w, h) in
            [(left, top, side, 2), (left, top + side, side + 2, 2), (left, top, 2, side), (left + side, top, 2, side)]
        {
            canvas.rectangle(x, y, w, h, BOX);
        }
    }
    let png = encode_png8(canvas.width, canvas.height, 3, &canvas.rgb).unwrap_or_default();
    Shown { title, text, uri: format!("data:image/png;base64,{}", BASE64_STANDARD.encode(png)) }
}
