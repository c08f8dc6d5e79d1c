//! Files of an inspection: difference maps, pages, and the table of a batch.

use crate::defect::Class;
use crate::inspection::Inspection;
use crate::page::{batch_page, sheet_page};
use crate::report::{Report, SheetReport, Verdict};
use nacre_base::{OutputFolder, Result};
use nacre_image::{Attribute, write_exr};
use std::fmt::Write;

/// Channels of `difference.exr`.
const CHANNELS: [&str; 9] = [
    "orientation",
    "orientation_sigma",
    "presence",
    "presence_sigma",
    "brightness",
    "brightness_sigma",
    "period",
    "statistic",
    "defect",
];

/// Writes `difference.exr` and `report.html` of a sheet; `folder` is empty or ends with a slash.
pub fn write_sheet(
    out: &OutputFolder,
    folder: &str,
    report: &Report,
    sheet: &SheetReport,
    found: &Inspection,
) -> Result<()> {
    let differences = &found.differences;
    let width = differences.width;
    let units = "orientation: rad; presence: degree of polarization; brightness, period: logarithm; \
                 statistic: standard deviations; defect: number from 1";
    let attributes = [("units", Attribute::Text(units.into()))];
    let plane = |d: &[f32], i: usize| d.get(i).copied().unwrap_or(f32::NAN);
    let value = |c: usize, i: usize| match c {
        0 => differences.orientation(i).map_or(f32::NAN, |d| d[0]),
        1 => differences.orientation(i).map_or(f32::NAN, |d| d[1]),
        2 => differences.presence(i).unwrap_or(f32::NAN),
        3 => differences.sigma[i],
        4 => plane(&differences.light.value, i),
        5 => plane(&differences.light.sigma, i),
        6 => plane(&differences.period.value, i),
        7 => differences.statistic[i],
        _ => found.regions.labels[i] as f32,
    };
    let file = out.path(&format!("{folder}difference.exr"));
    write_exr(&file, width, differences.height, &CHANNELS, &attributes, &|c, y, row| {
        row.iter_mut().enumerate().for_each(|(x, v)| *v = value(c, y * width + x));
    })?;
    out.write(&format!("{folder}report.html"), sheet_page(report, sheet, found).as_bytes())
}

/// Writes `index.html` and `summary.csv` of a folder of sheets.
pub fn write_batch(out: &OutputFolder, report: &Report) -> Result<()> {
    let mut csv = String::from("sample,verdict,defects");
    Class::ALL.iter().for_each(|class| _ = write!(csv, ",{}", class.name()));
    csv.push_str(",largest_deviation,threshold,turn_deg,shift_x_px,shift_y_px,overlap,exceeded\n");
    for sheet in &report.sheets {
        let verdict = if sheet.verdict == Verdict::Accept { "accept" } else { "reject" };
        _ = write!(csv, "{},{verdict},{}", quoted(&sheet.sample.name), sheet.defects.len());
        Class::ALL.iter().for_each(|class| _ = write!(csv, ",{}", sheet.count(*class)));
        let r = &sheet.registration;
        _ = writeln!(
            csv,
            ",{:.3},{:.3},{:.4},{:.3},{:.3},{:.4},{}",
            sheet.largest_deviation,
            sheet.threshold,
            r.turn_deg,
            r.shift_px[0],
            r.shift_px[1],
            r.overlap,
            quoted(&sheet.exceeded.join("; "))
        );
    }
    out.write("summary.csv", csv.as_bytes())?;
    out.write("index.html", batch_page(report).as_bytes())
}

/// A field of a CSV file.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}
