use super::{lattice, room};
use crate::environment::factor::{Factors, Kind, Options, Settings};
use crate::environment::{Environment, Table, facing, two_pass};
use nacre_base::operation::perform;
use nacre_base::progress::Silent;
use nacre_image::{Attribute, read_exr, write_exr};
use std::f64::consts::{FRAC_PI_2, TAU};
use std::path::Path;

/// Writes a table as `reconstruct lut` does; its Y is read back as green.
fn write(table: &Table, path: &Path) {
    let attributes = [("extent", Attribute::Text(table.extent.to_string())), ("warp", Attribute::Text("1".into()))];
    let n = table.size;
    let row = |_: usize, y: usize, row: &mut [f32]| {
        row.iter_mut().enumerate().for_each(|(x, out)| *out = table.rgb[y * n + x][1]);
    };
    write_exr(path, n, n, &["X", "Y", "Z", "coverage"], &attributes, &row).unwrap();
}

#[test]
fn a_table_is_factorised_into_files() {
    let folder = tempfile::tempdir().unwrap();
    let [lut, sky, out] = ["lut.exr", "sky.exr", "out"].map(|name| folder.path().join(name));
    write(&lattice(96, 0.7, [0.2, 1.7], 0.17, 0.04), &lut);
    let environment = room(128);
    let light = |c: usize, y: usize, row: &mut [f32]| {
        row.iter_mut().enumerate().for_each(|(x, out)| *out = environment.rgb[y * 128 + x][c]);
    };
    write_exr(&sky, 128, 64, &["R", "G", "B"], &[], &light).unwrap();
    let options = Options { max_error: 0.02, environment: Some(sky.clone()), ..Options::default() };
    let factor = |options: &Options, overwrite| perform(options, &lut, &out, overwrite, &Silent);
    let report = factor(&options, false).unwrap();
    assert!(report.error <= 0.02 && report.separable && report.picture_error.unwrap() < 0.02, "{report:?}");
    assert_eq!(report.pattern, "two directions");
    let across = read_exr(&out.join("part-1-across.exr")).unwrap();
    assert_eq!((across.width, across.height), (96, report.parts[0].rank));
    assert!(across.attributes.contains_key("meridian_deg") && out.join("factors.png").exists());
    assert!(std::fs::read_to_string(out.join("report.json")).unwrap().contains("\"low-rank\""));
    // Existing results are kept unless `force` is set.
    assert!(factor(&options, false).is_err());
    assert!(factor(&options, true).is_ok());
    // One of several pictures is selected by name.
    let names = ["day.R", "day.G", "day.B", "night.R", "night.G", "night.B"];
    write_exr(&sky, 128, 64, &names, &[], &|c, y, row| light(c % 3, y, row)).unwrap();
    let words = factor(&options, true).unwrap_err().to_string();
    assert!(words.contains("\"day\", \"night\"") && words.contains("--layer"), "{words}");
    let night = factor(&Options { layer: Some("night".into()), ..options }, true).unwrap();
    assert!((night.picture_error.unwrap() - report.picture_error.unwrap()).abs() < 1e-9);
}

#[test]
fn bad_input_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let [lut, sky, out] = ["lut.exr", "sky.exr", "out"].map(|name| folder.path().join(name));
    write(&lattice(32, 0.7, [0.2, 1.7], 0.17, 0.04), &lut);
    write_exr(&sky, 16, 8, &["R", "G", "B"], &[], &|_, _, row| row.fill(f32::INFINITY)).unwrap();
    let options = Options { environment: Some(sky.clone()), ..Options::default() };
    let words = perform(&options, &lut, &out, false, &Silent).unwrap_err().to_string();
    assert!(words.contains("sky.exr") && words.contains("inf"), "{words}");
    let words = perform(&Options::default(), &sky, &out, false, &Silent).unwrap_err().to_string();
    assert!(words.contains("sky.exr"), "{words}");
    assert!(!out.exists());
}

/// The curves of the files reproduce the table; `value` is its source.
#[test]
fn terms_add_up_to_the_table() {
    let table = lattice(96, 0.7, [0.2, 1.7], 0.17, 0.05);
    let settings = Settings { rank: Some(40), directions: Some([0.2, 1.7]), ..Settings::default() };
    let factors = Factors::of(&table, &settings).unwrap();
    let (mut square, mut whole) = (0.0, 0.0);
    for k in 0..60 {
        for j in 0..60 {
            let h = [f64::from(k) * 0.02 - 0.6, f64::from(j) * 0.02 - 0.6];
            let (found, truth) = (factors.value(h)[1], f64::from(table.at(h)[1]));
            square += (found - truth).powi(2);
            whole += truth * truth;
        }
    }
    // Cells are read without interpolation, so positions are off by up to half a cell.
    assert!((square / whole).sqrt() < 0.15, "{}", (square / whole).sqrt());
}

#[test]
fn turning_the_light_turns_the_picture() {
    let (environment, table) = (room(128), lattice(64, 0.7, [0.2, 1.7], 0.2, 0.05));
    let settings = Settings { rank: Some(6), directions: Some([0.2, 1.7]), ..Settings::default() };
    let part = &Factors::of(&table, &settings).unwrap().parts[0];
    let turn = TAU * 20.0 / 128.0;
    let turned = |rgb: Vec<[f32; 3]>| {
        let rgb = rgb.into_iter().map(|p| p.map(|v| v.max(0.0))).collect();
        Environment::of(128, 64, rgb).unwrap().turned(turn).rgb
    };
    let pairs = [
        (two_pass(&environment, part, &Silent), two_pass(&environment.turned(turn), part, &Silent)),
        (
            facing(&environment, &table, FRAC_PI_2, &Silent),
            facing(&environment.turned(turn), &table, FRAC_PI_2, &Silent),
        ),
    ];
    for (before, after) in pairs {
        let (before, after) = (turned(before.unwrap()), after.unwrap());
        let most = before.as_flattened().iter().fold(0.0_f32, |m, v| m.max(*v));
        let off = before.as_flattened().iter().zip(after.as_flattened()).map(|(a, b)| (a - b.max(0.0)).abs());
        assert!(off.fold(0.0, f32::max) < 1e-5 * most);
    }
}

/// One part as an independent reader of the files sees it, without the code that wrote them.
struct Written {
    attributes: [f64; 4],
    size: [usize; 2],
    /// Rows of terms, for each channel.
    curves: [[Vec<f32>; 3]; 2],
}

impl Written {
    fn read(out: &Path, part: usize) -> Self {
        let files = ["across", "along"].map(|name| read_exr(&out.join(format!("part-{part}-{name}.exr"))).unwrap());
        let attributes = ["meridian_deg", "shear_deg", "reach_x", "reach_beta"]
            .map(|name| files[0].attributes[name].parse::<f64>().unwrap());
        let size = [files[0].width, files[1].width];
        Self { attributes, size, curves: files.map(|mut f| ["R", "G", "B"].map(|c| f.channels.remove(c).unwrap())) }
    }

    /// Sum of the terms at a half vector: of the nearest cell, or interpolated between cells.
    fn at(&self, channel: usize, h: [f64; 2], between: bool) -> f64 {
        let [meridian, shear, reach_x, reach_beta] = self.attributes;
        let ((s, c), shear) = (meridian.to_radians().sin_cos(), shear.to_radians());
        let (x, y) = (h[0] * s - h[1] * c, h[0] * c + h[1] * s);
        let sine = x / shear.cos();
        let lean = (sine / (1.0 - sine * sine).sqrt() * shear.sin()).atan();
        let beta = y.atan2((1.0 - x * x - y * y).sqrt()) - lean;
        let places = [(x, reach_x, 0), (beta, reach_beta, 1)].map(|(v, reach, k)| {
            let at = (v / reach + 1.0) * 0.5 * self.size[k] as f64;
            (0.0..self.size[k] as f64).contains(&at).then_some(at)
        });
        let [Some(across), Some(along)] = places else { return 0.0 };
        let value = |k: usize, term: usize, at: f64| {
            let row = &self.curves[k][channel][term * self.size[k]..][..self.size[k]];
            let at = if between { (at - 0.5).clamp(0.0, (row.len() - 1) as f64) } else { at.floor() };
            let next = row[(at as usize + 1).min(row.len() - 1)];
            let share = at - at.floor();
            (1.0 - share) * f64::from(row[at as usize]) + share * f64::from(next)
        };
        let terms = self.curves[0][channel].len() / self.size[0];
        (0..terms).map(|term| value(0, term, across) * value(1, term, along)).sum()
    }
}

/// Error of the files in `out` against the table.
fn written_error(out: &Path, parts: usize, table: &Table, between: bool) -> f64 {
    const FINER: usize = 4;
    let written: Vec<Written> = (1..=parts).map(|part| Written::read(out, part)).collect();
    let n = FINER * table.size;
    let (mut square, mut whole) = (0.0, 0.0);
    for i in 0..n * n {
        let h = [i % n, i / n].map(|k| ((k as f64 + 0.5) / n as f64 * 2.0 - 1.0) * table.extent);
        let z2 = 1.0 - h[0] * h[0] - h[1] * h[1];
        if z2 <= 0.0 {
            continue;
        }
        let z = z2.sqrt();
        for (c, light) in table.at(h).into_iter().enumerate() {
            let truth = f64::from(light) * (1.0 + z).powi(2);
            let found: f64 = written.iter().map(|w| w.at(c, h, between)).sum();
            // Solid angle per area of h is 1 / z.
            square += (found - truth).powi(2) / z;
            whole += truth * truth / z;
        }
    }
    (square / whole).sqrt()
}

#[test]
fn errors_are_those_of_the_files() {
    let spots = lattice(64, 0.65, [0.2, 1.7], 0.17, 0.05);
    let streaks = Table::from_fn(64, 0.65, |h| {
        let line = |a: f64| (-((h[1] * a.cos() - h[0] * a.sin()) / 0.03).powi(2)).exp();
        [[0.2, 1.25, 2.3].into_iter().map(line).sum::<f64>() * (-h[0].hypot(h[1]) / 0.3).exp(); 3]
    })
    .unwrap();
    let usual = Options::default;
    for (name, table, options, between) in [
        ("singular", &spots, Options { rank: Some(2), ..usual() }, true),
        ("nonnegative", &spots, Options { rank: Some(3), kind: Kind::Nonnegative, ..usual() }, true),
        ("line", &spots, Options { kind: Kind::Line, ..usual() }, false),
        ("line of 24", &streaks, Options { rank: Some(24), kind: Kind::Line, ..usual() }, false),
        ("parts", &streaks, Options { rank: Some(1), parts: 3, ..usual() }, true),
        ("non-negative parts", &streaks, Options { rank: Some(1), parts: 2, kind: Kind::Nonnegative, ..usual() }, true),
        ("parts that are lines", &streaks, Options { parts: 3, kind: Kind::Line, ..usual() }, false),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let [lut, out] = ["lut.exr", "out"].map(|name| folder.path().join(name));
        write(table, &lut);
        let report = perform(&options, &lut, &out, false, &Silent).unwrap();
        let read = Table::read(&lut).unwrap();
        let error = |folder: &Path, between: bool| written_error(folder, options.parts, &read, between);
        let truth = error(&out, between);
        let range = if options.parts > 1 && between {
            // The parts have different grids. The error depends on whether none, some or all of them are interpolated.
            [truth, error(&out, false)]
        } else if between {
            // Interpolation adds the error that curves without truncation have.
            let whole = folder.path().join("whole");
            let all = Options { rank: Some(24), ..usual() };
            let full = perform(&all, &lut, &whole, false, &Silent).unwrap();
            let interpolation = error(&whole, true).powi(2) - full.error.powi(2);
            [(truth.powi(2) - interpolation).max(0.0).sqrt(); 2]
        } else {
            [truth; 2]
        };
        println!("{name}: {}, from the files {range:?}, {:?}", report.error, report.warnings);
        assert_eq!(report.parts.len(), options.parts, "{name}");
        let [low, high] = [range[0].min(range[1]), range[0].max(range[1])];
        // Tolerance 15 %: the reader samples the table at other positions than the writer.
        assert!((0.85 * low..1.15 * high).contains(&report.error), "{name}: {} {range:?}", report.error);
        let rows = read_exr(&out.join("part-1-across.exr")).unwrap().height;
        assert_eq!(report.parts[0].rank, rows, "{name}");
        // A missed target error is reported.
        let missed = options.rank.is_none() && report.error > options.max_error;
        assert_eq!(report.warnings.iter().any(|w| w.contains("asked for")), missed, "{name}: {:?}", report.warnings);
        assert!(!missed || !report.separable && report.advice != "two passes", "{name}: {}", report.advice);
    }
}

/// A grating is a line: its light lies on the two central rows, and the residual is zero.
#[test]
fn a_line_is_right_for_a_grating() {
    let table =
        Table::from_fn(64, 0.65, |h| [if h[1].abs() < 0.65 / 64.0 * 2.0 { (-h[0].abs() / 0.3).exp() } else { 0.0 }; 3])
            .unwrap();
    let of = |kind| Factors::of(&table, &Settings { kind, directions: Some([0.0, FRAC_PI_2]), ..Settings::default() });
    let (line, singular) = (of(Kind::Line).unwrap().error(), of(Kind::Singular).unwrap().error());
    println!("line {line}, singular {singular}");
    // The default target is 5 %; the residual of a line is the difference of its two rows (8 %).
    assert!(line < 0.15 && singular < 0.05, "{line} {singular}");
}
