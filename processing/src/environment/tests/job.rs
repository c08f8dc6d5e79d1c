use super::{lattice, room};
use crate::environment::factor::{Factors, Job, Settings, factor};
use crate::environment::{Environment, Table, facing, two_pass};
use crate::image::{Attribute, read_exr, write_exr};
use crate::progress::Silent;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::path::Path;

/// Writes a table as `reconstruct lut` does: its Y is the green of what is read.
fn write(table: &Table, path: &Path) {
    let attributes = [("extent", Attribute::Text("0.7".into())), ("warp", Attribute::Text("1".into()))];
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
    let settings = Settings { max_error: 0.02, ..Settings::default() };
    let job = Job { table: &lut, environment: Some(&sky), out: &out, settings, overwrite: false };
    let report = factor(&job, &Silent).unwrap();
    assert!(report.error <= 0.02 && report.separable && report.picture_error.unwrap() < 0.02, "{report:?}");
    assert_eq!(report.pattern, "two directions");
    let across = read_exr(&out.join("part-1-across.exr")).unwrap();
    assert_eq!((across.width, across.height), (96, report.parts[0].rank));
    assert!(across.attributes.contains_key("meridian_deg") && out.join("factors.png").exists());
    assert!(std::fs::read_to_string(out.join("report.json")).unwrap().contains("\"low-rank\""));
    // What is there stays, unless it may be replaced.
    assert!(factor(&job, &Silent).is_err());
    assert!(factor(&Job { overwrite: true, ..job }, &Silent).is_ok());
}

#[test]
fn bad_input_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let [lut, sky, out] = ["lut.exr", "sky.exr", "out"].map(|name| folder.path().join(name));
    write(&lattice(32, 0.7, [0.2, 1.7], 0.17, 0.04), &lut);
    write_exr(&sky, 16, 8, &["R", "G", "B"], &[], &|_, _, row| row.fill(f32::INFINITY)).unwrap();
    let job = Job { table: &lut, environment: Some(&sky), out: &out, settings: Settings::default(), overwrite: false };
    let words = factor(&job, &Silent).unwrap_err().to_string();
    assert!(words.contains("sky.exr") && words.contains("inf"), "{words}");
    let words = factor(&Job { table: &sky, environment: None, ..job }, &Silent).unwrap_err().to_string();
    assert!(words.contains("sky.exr"), "{words}");
    assert!(!out.exists());
}

/// The curves of the files are the table: `value` is what it was made of.
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
    // Cells are looked up without interpolation: half of one is off.
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
