//! Content of the report of one sheet, of which the HTML page and the PDF are made.

use crate::defect::{Class, Defect};
use crate::limits::{ClassLimits, Limits};
use crate::report::{Differs, Report, SheetReport};
use crate::sheet::{Origin, Signature};
use nacre_base::calendar::minutes;

/// A part of a report.
pub enum Block {
    /// Title of a section.
    Heading(String),
    /// Title within a section.
    Subheading(String),
    /// A paragraph.
    Text(String),
    /// A paragraph that warns.
    Warning(String),
    /// Points of a list.
    List(Vec<String>),
    /// The pictures, with boxes around the defects.
    Pictures,
    /// A table with a header row.
    Table {
        /// Header row.
        head: Vec<String>,
        /// Other rows.
        rows: Vec<Vec<String>>,
    },
    /// Files with their hashes.
    Files(Vec<Signature>),
}

/// Title of the report of a sheet.
pub fn title(sheet: &SheetReport) -> String {
    format!("Inspection of {}", sheet.sample.name)
}

/// All parts of the report of a sheet, in order.
pub fn blocks(report: &Report, sheet: &SheetReport) -> Vec<Block> {
    let heading = |text: &str| Block::Heading(text.to_owned());
    let compared = format!("Compared with {} on {}.", report.reference.name, minutes(report.inspected_s as i64));
    let mut all = vec![Block::Text(compared)];
    if !sheet.exceeded.is_empty() {
        all.extend([heading("Limits exceeded"), Block::List(sheet.exceeded.clone())]);
    }
    all.extend([heading("Pictures"), Block::Pictures, heading("Defects")]);
    all.extend(defects(sheet));
    all.push(heading("Differences"));
    all.push(differences(report, sheet));
    all.push(heading("Limits"));
    all.extend(limits(report, sheet));
    all.extend([heading("Registration"), Block::Text(registration(sheet))]);
    all.push(heading("Inputs"));
    all.extend(origin("Reference", &report.reference));
    all.extend(origin("Sample", &sheet.sample));
    if let Some(sha256) = &report.limits_sha256 {
        all.push(Block::Subheading("Limits".into()));
        all.push(Block::Files(vec![Signature { file: "limits.toml".into(), sha256: sha256.clone() }]));
    }
    all.extend(sheet.warnings.iter().cloned().map(Block::Warning));
    all
}

fn words(all: &[&str]) -> Vec<String> {
    all.iter().map(|w| (*w).to_owned()).collect()
}

fn defects(sheet: &SheetReport) -> Vec<Block> {
    if sheet.defects.is_empty() {
        return vec![Block::Text("None.".into())];
    }
    let share = |value: Option<f64>| value.map_or("–".into(), |v| format!("{:.0} %", 100.0 * v));
    let row = |(k, d): (usize, &Defect)| {
        vec![
            (k + 1).to_string(),
            d.class.label().into(),
            match sheet.at_mm(d) {
                Some([x, y]) => format!("{x:.2}, {y:.2} mm"),
                None => format!("{:.0}, {:.0} px", d.at_px[0], d.at_px[1]),
            },
            d.area_mm2.map_or_else(|| format!("{:.0} px", d.area_px), |mm2| format!("{mm2:.3} mm²")),
            match d.size_mm {
                Some([length, width]) => format!("{length:.2} × {width:.2} mm"),
                None => format!("{:.1} × {:.1} px", d.size_px[0], d.size_px[1]),
            },
            format!("{:.1} σ", d.deviation),
            d.orientation_deg.map_or("–".into(), |deg| format!("{deg:+.1}°")),
            share(Some(d.polarization)),
            share(d.brightness),
            share(d.period),
        ]
    };
    let head =
        ["No.", "Class", "Position", "Area", "Size", "Deviation", "Turned", "Polarization", "Brightness", "Period"];
    let position = if sheet.pixel_um.is_some() {
        "Positions are right of and above the middle of the reference."
    } else {
        "Positions are columns and rows of the reference."
    };
    vec![
        Block::Table { head: words(&head), rows: sheet.defects.iter().enumerate().map(row).collect() },
        Block::Text(format!("{position} Polarization, brightness and period are relative to the reference.")),
    ]
}

fn differences(report: &Report, sheet: &SheetReport) -> Block {
    let (all, limits) = (&sheet.differences, &report.limits.sheet);
    let row = |name: &str, differs: Option<Differs>, limit: Option<f64>, unit: &str| {
        let limit = limit.map_or("–".into(), |l| format!("{l:.4}{unit}"));
        let values = differs.map_or_else(
            || words(&["not compared", "–", "–"]),
            |d| {
                vec![
                    format!("{:.4}{unit}", d.rms),
                    format!("{:.4}{unit}", d.sigma),
                    format!("{:.3} %", 100.0 * d.beyond),
                ]
            },
        );
        [vec![name.to_owned()], values, vec![limit]].concat()
    };
    Block::Table {
        head: words(&["Quantity", "Root mean square", "σ of a pixel", "Beyond 3 σ", "Limit"]),
        rows: vec![
            row("Orientation", all.orientation_deg, limits.max_orientation_deg, "°"),
            row("Presence (degree of polarization)", all.presence, limits.max_presence, ""),
            row("Brightness (logarithm)", all.brightness, limits.max_brightness, ""),
            row("Period (logarithm)", all.period, limits.max_period, ""),
        ],
    }
}

fn limits(report: &Report, sheet: &SheetReport) -> Vec<Block> {
    let trained = match report.limits.samples {
        0 => String::new(),
        n => format!(" Limits from {n} good samples."),
    };
    let threshold = format!(
        "A defect has a deviation of at least {:.2} σ and {} pixels, for {} false alarms per sheet.{trained}",
        sheet.threshold, report.min_area_px, report.false_alarms
    );
    let overlap = report.limits.sheet.min_overlap;
    let overlap =
        overlap.map(|least| Block::Text(format!("At least {:.1} % of the reference is seen.", 100.0 * least)));
    [Some(Block::Text(threshold)), overlap, Some(by_class(&report.limits))].into_iter().flatten().collect()
}

fn by_class(limits: &Limits) -> Block {
    let row = |class: Class| {
        let any = ClassLimits::default();
        let of = limits.defects.get(&class).unwrap_or(&any);
        let number = |value: Option<f64>, unit: &str| value.map_or("any".into(), |v| format!("{v} {unit}"));
        vec![
            class.label().to_owned(),
            of.max_count.map_or("any".into(), |n| n.to_string()),
            match of.max_area_mm2 {
                None => number(of.max_area_px, "px"),
                area => number(area, "mm²"),
            },
            number(of.max_length_mm, "mm"),
        ]
    };
    Block::Table {
        head: words(&["Class", "Largest number", "Largest area", "Largest length"]),
        rows: Class::ALL.map(row).into(),
    }
}

fn registration(sheet: &SheetReport) -> String {
    let r = &sheet.registration;
    let shift = match r.shift_mm {
        Some([x, y]) => format!("{x:.3} mm right, {y:.3} mm down"),
        None => format!("{:.2} px right, {:.2} px down", r.shift_px[0], r.shift_px[1]),
    };
    format!(
        "{} · turned {:.3}° · shifted {shift} (σ {:.3} px) · scale {:.5} · {:.1} % of the reference seen · orientations \
         off by {:.3}° ± {:.3}°",
        r.kind,
        r.turn_deg,
        r.sigma_px,
        r.scale,
        100.0 * r.overlap,
        sheet.offset_deg,
        sheet.offset_sigma_deg
    )
}

/// Name, time, devices and files of a sheet.
pub fn origin(title: &str, origin: &Origin) -> Vec<Block> {
    let captured = origin.captured_s.map(|s| Block::Text(format!("Captured {}.", minutes(s as i64))));
    let devices = (!origin.devices.is_empty()).then(|| Block::Text(format!("Devices: {}", origin.devices.join("; "))));
    let name = Block::Subheading(format!("{title}: {}", origin.name));
    [Some(name), captured, devices, Some(Block::Files(origin.files.clone()))].into_iter().flatten().collect()
}
