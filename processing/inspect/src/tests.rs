//! Inspection of synthetic sheets, rendered without the simulator.

use super::*;
use nacre_base::progress::Silent;
use nacre_base::random::Stream;
use num_complex::Complex32;

/// Side of a sheet in pixels.
const SIDE: usize = 160;

/// Degree of polarization of gratings, noise of S1 and S2 relative to the brightness.
const POLARIZED: f32 = 0.7;
const NOISE: f32 = 0.01;

/// Seed of all sheets.
const SEED: u64 = 5;

/// A disc of the sheet that differs: centre from the middle of the reference and radius in pixels, polarization over
/// the intended one, and brightness.
#[derive(Clone, Copy)]
struct Spot {
    at: [f64; 2],
    radius: f64,
    polarization: Complex32,
    brightness: f32,
}

/// Pose of a sheet: turn in rad and shift in pixels.
type Pose = (f64, [f64; 2]);

/// Number of the nearest cell and of the last spot at a point in pixels from the middle of the sheet, y up.
fn place(cells: &[[f64; 3]], x: f64, y: f64, spots: &[Spot]) -> (usize, Option<usize>) {
    let distance = |k: &usize| (cells[*k][0] - x).hypot(cells[*k][1] - y);
    let near = (0..cells.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
    (near, spots.iter().rposition(|s| (s.at[0] - x).hypot(s.at[1] - y) < s.radius))
}

/// Polarization and brightness of the sheet at a point.
fn surface(cells: &[[f64; 3]], x: f64, y: f64, spots: &[Spot]) -> (Complex32, f32) {
    let (cell, spot) = place(cells, x, y, spots);
    let polarization = Complex32::from_polar(POLARIZED, (2.0 * (cells[cell][2] + 0.01 * x)) as f32);
    spot.map_or((polarization, 1.0), |k| (polarization * spots[k].polarization, spots[k].brightness))
}

/// Points per pixel along each axis, where it has an edge.
const FINE: i32 = 8;

fn sheet(noise_seed: u64, (turn, shift): Pose, spots: &[Spot]) -> Sheet {
    let mut random = Stream::of(SEED);
    let cells: Vec<[f64; 3]> = (0..30)
        .map(|_| [0, 1, 2].map(|k| if k < 2 { 240.0 * (random.next() - 0.5) } else { 3.0 * random.next() }))
        .collect();
    let (mut noise, half) = (Stream::of(noise_seed), 0.5 * (SIDE as f64 - 1.0));
    let (sin, cos) = turn.sin_cos();
    let spin = Complex32::from_polar(1.0, (2.0 * turn) as f32);
    let on_sheet = |i: usize, dx: f64, dy: f64| {
        let (x, y) = ((i % SIDE) as f64 + dx - half - shift[0], half - (i / SIDE) as f64 - dy + shift[1]);
        (x * cos + y * sin, y * cos - x * sin)
    };
    let pixel = |i: usize| {
        let corner = |k: u8| {
            let (x, y) = on_sheet(i, f64::from(k % 2) - 0.5, f64::from(k / 2) - 0.5);
            place(&cells, x, y, spots)
        };
        let fine = if (1..4).all(|k| corner(k) == corner(0)) { 1 } else { FINE };
        let mut sum = [0.0; 3];
        for k in 0..fine * fine {
            let offset = |k: i32| (f64::from(k) + 0.5) / f64::from(fine) - 0.5;
            let (x, y) = on_sheet(i, offset(k % fine), offset(k / fine));
            let (p, light) = surface(&cells, x, y, spots);
            let p = p * spin * light;
            [p.re, p.im, light].iter().zip(&mut sum).for_each(|(v, s)| *s += v / (fine * fine) as f32);
        }
        sum
    };
    let values = (0..SIDE * SIDE).map(pixel).collect();
    let mut image = Image { width: SIDE, height: SIDE, values }.blurred(0.6);
    for value in &mut image.values {
        let mut normal = || (-2.0 * noise.next().max(1e-12).ln()).sqrt() * (std::f64::consts::TAU * noise.next()).cos();
        let scale = NOISE * value[2].sqrt();
        let [a, b, c] = [normal(), normal(), normal()].map(|v| v as f32 * scale);
        *value = [value[0] + a, value[1] + b, value[2] + c * std::f32::consts::FRAC_1_SQRT_2];
    }
    let sigma: Vec<f32> = image.values.iter().map(|v| NOISE * v[2].max(0.0).sqrt()).collect();
    let origin = Origin { name: "sheet".into(), files: vec![], devices: vec![], captured_s: None, measured: true };
    let (periods, has_light, pixel_um) = (None, true, Some(100.0));
    let orientations = unit_length(&image, &sigma);
    Sheet { image, sigma, overexposed: vec![false; SIDE * SIDE], orientations, periods, has_light, pixel_um, origin }
}

/// The sheet as maps of orientations show it: below five standard deviations there is no grating.
fn unit_length(image: &Image, sigma: &[f32]) -> (Image, Vec<f32>) {
    let unit = |(value, sigma): (&[f32; 3], &f32)| {
        let size = value[0].hypot(value[1]);
        let known = size > 5.0 * sigma;
        if known { ([value[0] / size, value[1] / size, 1.0], sigma / size) } else { ([0.0, 0.0, 1.0], 0.0) }
    };
    let (values, sigma) = image.values.iter().zip(sigma).map(unit).unzip();
    (Image { values, ..*image }, sigma)
}

const PARAMETERS: Parameters = Parameters { false_alarms: 0.1, min_area_px: 4, max_turn_deg: 6.0, trained: None };

fn spots() -> Vec<(Class, Spot)> {
    let spot = |at, polarization: Complex32, brightness| Spot { at, radius: 2.5, polarization, brightness };
    let turned = |degrees: f32| Complex32::from_polar(1.0, 2.0 * degrees.to_radians());
    vec![
        (Class::Missing, spot([20.0, 10.0], Complex32::new(0.0, 0.0), 2.0)),
        (Class::WrongOrientation, spot([-30.0, 25.0], turned(15.0), 1.0)),
        (Class::WrongOrientation, spot([10.0, -35.0], turned(-70.0), 1.0)),
        (Class::WrongPeriod, spot([-15.0, -20.0], Complex32::new(0.75, 0.0), 1.0)),
        (Class::Dirt, spot([35.0, -10.0], Complex32::new(0.0, 0.0), 0.1)),
    ]
}

#[test]
fn an_unchanged_sheet_has_no_defect_however_it_lies() {
    println!("seed {SEED}");
    let reference = sheet(1, (0.0, [0.0; 2]), &[]);
    for (noise, pose) in [(2, (0.0, [0.0; 2])), (3, (3.0_f64.to_radians(), [20.0, -9.0])), (4, (-0.05, [-7.3, 12.6]))] {
        let found = inspect(&reference, &sheet(noise, pose, &[]), &PARAMETERS, &Silent).unwrap();
        let r = &found.registration;
        assert!(found.regions.defects.is_empty(), "{pose:?}: {:?}", found.regions.defects);
        assert!((r.turn_deg - pose.0.to_degrees()).abs() < 0.02, "{r:?}");
        assert!(r.shift_px.iter().zip(pose.1).all(|(a, b)| (a - b).abs() < 0.05), "{pose:?}: {r:?}");
        assert!(found.offset_deg.abs() < 0.05, "{}", found.offset_deg);
    }
}

#[test]
fn defects_are_found_where_they_are_with_their_class() {
    println!("seed {SEED}");
    let reference = sheet(1, (0.0, [0.0; 2]), &[]);
    let planted = spots();
    let all: Vec<Spot> = planted.iter().map(|s| s.1).collect();
    let found = inspect(&reference, &sheet(2, (0.03, [6.0, 3.5]), &all), &PARAMETERS, &Silent).unwrap();
    let half = 0.5 * (SIDE as f64 - 1.0);
    for (class, spot) in &planted {
        let at = [half + spot.at[0], half - spot.at[1]];
        let near = |d: &&Defect| (d.at_px[0] - at[0]).hypot(d.at_px[1] - at[1]) < 1.0;
        let defect = found.regions.defects.iter().find(near).unwrap_or_else(|| panic!("{class:?} at {at:?}"));
        assert_eq!(defect.class, *class, "{defect:?}");
        // Of 20 pixels.
        assert!((10.0..40.0).contains(&defect.area_px), "{defect:?}");
    }
    assert_eq!(found.regions.defects.len(), planted.len(), "{:?}", found.regions.defects);
}

#[test]
fn a_common_offset_is_estimated_and_is_no_defect() {
    let reference = sheet(1, (0.0, [0.0; 2]), &[]);
    let mut sample = sheet(2, (0.02, [3.0, 1.0]), &[]);
    let offset = Complex32::from_polar(1.0, 2.0 * 12.0_f32.to_radians());
    for value in &mut sample.image.values {
        let turned = Complex32::new(value[0], value[1]) * offset;
        (value[0], value[1]) = (turned.re, turned.im);
    }
    let found = inspect(&reference, &sample, &PARAMETERS, &Silent).unwrap();
    assert!((found.offset_deg - 12.0).abs() < 0.05, "{}", found.offset_deg);
    assert!(found.offset_sigma_deg > 0.0 && found.offset_sigma_deg < 0.05, "{}", found.offset_sigma_deg);
    assert!(found.regions.defects.is_empty(), "{:?}", found.regions.defects);
}

#[test]
fn a_sheet_without_brightness_still_shows_orientations_and_presence() {
    let reference = sheet(1, (0.0, [0.0; 2]), &[]).without_light();
    let all: Vec<Spot> = spots().iter().map(|s| s.1).collect();
    let found = inspect(&reference, &sheet(2, (0.02, [3.0, 1.0]), &all).without_light(), &PARAMETERS, &Silent).unwrap();
    let count = |class| found.regions.defects.iter().filter(|d| d.class == class).count();
    assert_eq!(count(Class::WrongOrientation), 2, "{:?}", found.regions.defects);
    assert_eq!(count(Class::Missing), 2, "no grating, whether dirt or metal: {:?}", found.regions.defects);
}

#[test]
fn another_sheet_is_refused() {
    let reference = sheet(1, (0.0, [0.0; 2]), &[]);
    let mut other = reference.clone();
    let mut random = Stream::of(9);
    for value in &mut other.image.values {
        let p = Complex32::from_polar(POLARIZED, (std::f64::consts::TAU * random.next()) as f32);
        *value = [p.re, p.im, 1.0];
    }
    let refused = inspect(&reference, &other, &PARAMETERS, &Silent).err().map(|e| e.to_string());
    assert!(refused.as_ref().is_some_and(|e| e.contains("nowhere like")), "{refused:?}");
}

#[test]
fn trained_limits_accept_good_sheets_and_survive_their_file() {
    let reference = sheet(1, (0.0, [0.0; 2]), &[]);
    let report = |noise: u64, spots: &[Spot]| {
        let sample = sheet(noise, (0.004 * noise as f64, [noise as f64, 0.5]), spots);
        let found = inspect(&reference, &sample, &PARAMETERS, &Silent).unwrap();
        SheetReport::new(&reference, &sample, &found)
    };
    let good: Vec<SheetReport> = (2..7).map(|noise| report(noise, &[])).collect();
    assert!(Limits::trained(&good[..2], 0.1).is_err());
    let limits = Limits::trained(&good, 0.1).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("limits.toml");
    std::fs::write(&path, limits.to_toml()).unwrap();
    assert_eq!(Limits::read(&path).unwrap(), limits);
    assert!(good.iter().all(|sheet| limits.exceeded(sheet).is_empty()));
    let bad = report(8, &[spots()[0].1]).judged(&limits);
    assert_eq!(bad.verdict, Verdict::Reject);
    assert!(bad.exceeded.iter().any(|e| e.contains("class missing")), "{:?}", bad.exceeded);
    std::fs::write(&path, "version = 2\n").unwrap();
    assert!(Limits::read(&path).unwrap_err().to_string().contains("newer"));
}
