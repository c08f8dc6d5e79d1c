//! Pictures of an inspection, and the boxes around its defects.

use crate::inspection::Inspection;
use crate::report::SheetReport;
use nacre_image::{MASKED, Palette, encode_png8, viridis};

/// Longest side of a picture in pixels; larger maps are thinned.
const LONGEST: usize = 1024;

/// Margin of a box in pixels of the map.
const MARGIN: f64 = 4.0;

/// A picture of an inspection.
pub struct Shown {
    /// Name of its file.
    pub file: &'static str,
    /// Title.
    pub title: &'static str,
    /// Explanation of the colours.
    pub text: String,
    /// Pixels per row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Red, green and blue of all pixels.
    pub rgb: Vec<u8>,
}

impl Shown {
    /// The picture as a PNG.
    pub fn png(&self) -> Vec<u8> {
        encode_png8(self.width, self.height, 3, &self.rgb).unwrap_or_default()
    }
}

/// A square around a defect, in fractions of the picture's width and height.
pub struct Marked {
    /// Number of the defect, from 1.
    pub number: usize,
    /// Left and top.
    pub corner: [f64; 2],
    /// Width and height.
    pub size: [f64; 2],
}

/// Squares around all defects of a sheet.
pub fn marks(sheet: &SheetReport) -> Vec<Marked> {
    let pixels = sheet.size_px.map(|n| n as f64);
    let mark = |(k, defect): (usize, &crate::Defect)| {
        let half = 0.5 * defect.size_px[0] + MARGIN;
        let ends = [0, 1].map(|axis| {
            let [low, high] = [-half, half].map(|reach| (defect.at_px[axis] + reach).clamp(0.0, pixels[axis]));
            [low / pixels[axis], (high - low) / pixels[axis]]
        });
        Marked { number: k + 1, corner: ends.map(|e| e[0]), size: ends.map(|e| e[1]) }
    };
    sheet.defects.iter().enumerate().map(mark).collect()
}

/// Orientations of reference and sample, the deviation, and the brightness where it is known.
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
        shown(found, ["sample.png", "Sample, registered: orientation"], angles.into(), &|i| {
            orientation(differences.sample[i], i)
        }),
        shown(found, ["reference.png", "Reference: orientation"], angles.into(), &|i| {
            orientation(differences.reference[i], i)
        }),
        shown(
            found,
            ["deviation.png", "Deviation"],
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
        all.push(shown(found, ["brightness.png", "Brightness"], text, &light));
    }
    all
}

fn shown(
    found: &Inspection,
    [file, title]: [&'static str; 2],
    text: String,
    color: &dyn Fn(usize) -> [u8; 3],
) -> Shown {
    let (columns, rows) = (found.differences.width, found.differences.height);
    let step = columns.max(rows).div_ceil(LONGEST).max(1);
    let (width, height) = (columns.div_ceil(step), rows.div_ceil(step));
    let pixel = |i: usize| color(i / width * step * columns + i % width * step);
    let rgb = (0..width * height).flat_map(pixel).collect();
    Shown { file, title, text, width, height, rgb }
}
