//! Files of an inspection: difference maps, pictures, reports and tables.

use crate::defect::Class;
use crate::inspection::Inspection;
use crate::page::{batch_page, sheet_page};
use crate::pdf::sheet_pdf;
use crate::pictures::pictures;
use crate::report::{Report, SheetReport, Verdict, by_deviation};
use nacre_base::text::csv_field;
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

/// Writes maps, pictures and reports of a sheet; `folder` is empty or ends with a slash.
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
    let mut numbers = vec![0.0; found.regions.defects.len() + 1];
    by_deviation(&found.regions).into_iter().enumerate().for_each(|(k, region)| numbers[region + 1] = 1.0 + k as f32);
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
        _ => numbers[found.regions.labels[i] as usize],
    };
    let file = out.path(&format!("{folder}difference.exr"));
    write_exr(&file, width, differences.height, &CHANNELS, &attributes, &|c, y, row| {
        row.iter_mut().enumerate().for_each(|(x, v)| *v = value(c, y * width + x));
    })?;
    let pictures = pictures(found);
    for picture in &pictures {
        out.write(&format!("{folder}{}", picture.file), &picture.png())?;
    }
    out.write(&format!("{folder}defects.csv"), defects_csv(sheet).as_bytes())?;
    out.write(&format!("{folder}report.html"), sheet_page(report, sheet, &pictures).as_bytes())?;
    out.write(&format!("{folder}report.pdf"), &sheet_pdf(report, sheet, &pictures)?)
}

/// Table of the defects of a sheet.
fn defects_csv(sheet: &SheetReport) -> String {
    let mut csv = String::from(
        "defect,class,x_px,y_px,x_mm,y_mm,area_px,area_mm2,length_px,width_px,deviation,false_alarms,orientation_deg,\
         polarization,brightness,period\n",
    );
    let number = |value: Option<f64>| value.map_or(String::new(), |v| format!("{v:.6}"));
    for (k, d) in sheet.defects.iter().enumerate() {
        let mm = sheet.at_mm(d);
        let cells = [
            Some(d.at_px[0]),
            Some(d.at_px[1]),
            mm.map(|p| p[0]),
            mm.map(|p| p[1]),
            Some(d.area_px),
            d.area_mm2,
            Some(d.size_px[0]),
            Some(d.size_px[1]),
            Some(d.deviation),
        ];
        let more = [d.orientation_deg, Some(d.polarization), d.brightness, d.period];
        let [cells, more] = [cells.map(number).join(","), more.map(number).join(",")];
        _ = writeln!(csv, "{},{},{cells},{:e},{more}", k + 1, d.class.name(), d.false_alarms);
    }
    csv
}

/// Writes `index.html` and `summary.csv` of a folder of sheets.
pub fn write_batch(out: &OutputFolder, report: &Report) -> Result<()> {
    let mut csv = String::from("sample,verdict,defects");
    Class::ALL.iter().for_each(|class| _ = write!(csv, ",{}", class.name()));
    csv.push_str(",largest_deviation,threshold,turn_deg,shift_x_px,shift_y_px,overlap,exceeded\n");
    for sheet in &report.sheets {
        let verdict = if sheet.verdict == Verdict::Accept { "accept" } else { "reject" };
        _ = write!(csv, "{},{verdict},{}", csv_field(&sheet.sample.name), sheet.defects.len());
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
            csv_field(&sheet.exceeded.join("; "))
        );
    }
    out.write("summary.csv", csv.as_bytes())?;
    out.write("index.html", batch_page(report).as_bytes())
}
