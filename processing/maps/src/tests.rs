use super::*;
use nacre_image::OutputFolder;
use std::collections::BTreeMap;
use std::f32::consts::PI;

/// Orientations that rotate about the centre as on a disc, periods that increase to the right; one corner is masked.
fn maps(width: usize, height: usize) -> Maps {
    let place =
        |i: usize| [(i % width) as f32 - 0.5 * (width as f32 - 1.0), 0.5 * (height as f32 - 1.0) - (i / width) as f32];
    let known = |i: usize| i % width + i / width > 2;
    let map = |value: &dyn Fn(usize) -> f32, sigma: f32, name: &str| Map {
        value: (0..width * height).map(|i| if known(i) { value(i) } else { f32::NAN }).collect(),
        sigma: (0..width * height).map(|i| if known(i) { sigma * (1.0 + i as f32 * 1e-3) } else { f32::NAN }).collect(),
        mask: (0..width * height).map(|i| f32::from(u8::from(known(i)))).collect(),
        more: BTreeMap::from([("extra".to_owned(), (0..width * height).map(|i| i as f32 / 7.0 - 3.0).collect())]),
        attributes: [("units", name), ("pixel_um", "12.5"), ("about", "a µ and a \"quote\"")]
            .map(|(a, b)| (a.to_owned(), b.to_owned()))
            .into(),
    };
    let radial = |i: usize| layout::wrapped(f64::from(place(i)[1].atan2(place(i)[0])));
    let rising = |i: usize| 0.8 + 0.01 * (i % width) as f32;
    let maps = [(Kind::Orientation, map(&radial, 0.01, "rad")), (Kind::Period, map(&rising, 0.002, "µm"))];
    Maps { width, height, maps: maps.into() }
}

/// True if all values are equal to the bit, including NaN.
fn same(a: &Maps, b: &Maps) -> bool {
    let bits = |plane: &[f32]| plane.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    let map = |m: &Map, k: Kind| m.planes(k).into_iter().map(|(n, p)| (n.to_owned(), bits(p))).collect::<Vec<_>>();
    [a.width, a.height] == [b.width, b.height]
        && a.maps.len() == b.maps.len()
        && a.maps
            .iter()
            .all(|(k, m)| b.maps.get(k).is_some_and(|o| map(m, *k) == map(o, *k) && m.attributes == o.attributes))
}

fn written(maps: &Maps, write: impl Fn(&OutputFolder)) -> tempfile::TempDir {
    let home = tempfile::tempdir().unwrap();
    let folder = OutputFolder::begin(&home.path().join("out"), false).unwrap();
    write(&folder);
    folder.commit().unwrap();
    assert!(!maps.maps.is_empty());
    home
}

fn apart(a: f32, b: f32) -> f32 {
    let d = (a - b).rem_euclid(PI);
    d.min(PI - d)
}

#[test]
fn maps_come_back_from_exr_and_from_a_pack_to_the_bit() {
    let mut all = maps(23, 17);
    // A NaN with payload, infinities, negative zero, and the smallest number.
    let odd = [f32::from_bits(0x7fc1_2345), f32::from_bits(0xffc0_0001), f32::INFINITY, f32::NEG_INFINITY, -0.0, 1e-45];
    all.maps.get_mut(&Kind::Period).unwrap().more.get_mut("extra").unwrap()[..6].copy_from_slice(&odd);
    let home = written(&all, |folder| all.write(folder).unwrap());
    assert!(same(&Maps::read(&home.path().join("out")).unwrap(), &all));
    let home = written(&all, |folder| export(&all, Encoding::Exact, folder).unwrap());
    let back = import(&home.path().join("out")).unwrap();
    assert!(same(&back, &all));
    // An edit commutes with export and import.
    let edits = Options { rotate_deg: Some(33.0), scale: Some(1.1), ..Options::default() };
    assert!(same(&edit(&back, &edits).unwrap(), &edit(&all, &edits).unwrap()));
}

#[test]
fn a_linear_pack_is_off_by_half_a_step_at_most() {
    let all = maps(40, 30);
    let home = written(&all, |folder| export(&all, Encoding::Linear, folder).unwrap());
    let back = import(&home.path().join("out")).unwrap();
    for kind in Kind::ALL {
        let (a, b) = (&all.maps[&kind], &back.maps[&kind]);
        let known: Vec<f32> = a.value.iter().copied().filter(|v| v.is_finite()).collect();
        let span = known.iter().copied().fold(f32::MIN, f32::max) - known.iter().copied().fold(f32::MAX, f32::min);
        for (x, y) in a.value.iter().zip(&b.value) {
            assert!(x.is_nan() && y.is_nan() || (x - y).abs() <= 0.51 * span / 65_534.0, "{x} {y}");
        }
        assert_eq!(a.mask, b.mask);
    }
}

#[test]
fn packs_from_elsewhere_are_checked() {
    let all = maps(8, 6);
    let home = written(&all, |folder| export(&all, Encoding::Exact, folder).unwrap());
    let out = home.path().join("out");
    let json = std::fs::read_to_string(out.join(PACK)).unwrap();
    for (from, to, words) in [
        ("\"width\": 8", "\"width\": 9", "says 9"),
        ("\"width\": 8", "\"width\": 99999999999", "pixels"),
        ("\"nacre_maps\": 1", "\"nacre_maps\": 2", "version 2"),
        ("\"nacre_maps\"", "\"nacre\"", "nacre"),
        ("orientation.mask.high.png", "../out/orientation.mask.high.png", "no file beside"),
        ("orientation.mask.high.png", "/etc/passwd", "no file beside"),
        ("orientation.mask.high.png", "none.png", "none.png"),
        ("\"sigma\"", "\"sigmas\"", "sigma"),
        ("\"period\": {", "\"depth\": {", "depth"),
    ] {
        assert!(json.contains(from), "{from}");
        std::fs::write(out.join(PACK), json.replacen(from, to, 1)).unwrap();
        let problem = import(&out).unwrap_err().to_string();
        assert!(problem.contains(words), "{words}: {problem}");
    }
    std::fs::write(out.join(PACK), &json[..json.len() / 2]).unwrap();
    assert!(import(&out).is_err());
    std::fs::write(out.join(PACK), &json).unwrap();
    std::fs::write(out.join("period.sigma.low.png"), [1, 2, 3]).unwrap();
    assert!(import(&out).unwrap_err().to_string().contains("period.sigma.low.png"));
}

#[test]
fn image_and_orientations_turn_together() {
    // The disc's orientation field is rotationally symmetric, except for the masked corner and the edges.
    for deg in [90.0, 180.0, 270.0, -90.0, 30.0, 77.0] {
        let all = maps(41, 41);
        let turned = all.rotated(deg).unwrap();
        let (w, h) = (turned.width, turned.height);
        let map = &turned.maps[&Kind::Orientation];
        let mut checked = 0;
        for i in (0..w * h).filter(|i| map.mask[*i] > 0.0) {
            let (x, y) = ((i % w) as f32 - 0.5 * (w as f32 - 1.0), 0.5 * (h as f32 - 1.0) - (i / w) as f32);
            // Near the centre, the orientation changes too fast for interpolation.
            if x.hypot(y) > 6.0 {
                assert!(apart(map.value[i], y.atan2(x)) < 0.02, "{deg} {x} {y} {}", map.value[i]);
                checked += 1;
            }
        }
        assert!(checked > 1300, "{deg} {checked}");
    }
    // Four rotations by 90° restore every value.
    let all = maps(9, 14);
    let mut turned = all.clone();
    for _ in 0..4 {
        turned = turned.rotated(90.0).unwrap();
    }
    for kind in Kind::ALL {
        for (a, b) in all.maps[&kind].value.iter().zip(&turned.maps[&kind].value) {
            assert!(a.is_nan() && b.is_nan() || apart(*a, *b) < 1e-6, "{a} {b}");
        }
    }
    // A rotation by 90° anticlockwise moves the right column to the top.
    let quarter = all.rotated(90.0).unwrap();
    assert_eq!([quarter.width, quarter.height], [14, 9]);
    assert_eq!(quarter.maps[&Kind::Period].value[3], all.maps[&Kind::Period].value[3 * 9 + 8]);
}

#[test]
fn copies_lie_as_the_layout_says() {
    let all = maps(6, 4);
    let at = |maps: &Maps, kind: Kind, x: usize, y: usize| maps.maps[&kind].value[y * maps.width + x];
    let twice = edit(&all, &Options { tile: Some([2, 3]), ..Options::default() }).unwrap();
    assert_eq!([twice.width, twice.height], [12, 12]);
    assert_eq!(at(&twice, Kind::Orientation, 6 + 4, 8 + 2), at(&all, Kind::Orientation, 4, 2));
    assert!(at(&twice, Kind::Period, 6, 4).is_nan());
    let mirror = edit(&all, &Options { tile: Some([2, 2]), layout: Layout::Mirror, ..Options::default() }).unwrap();
    assert_eq!(at(&mirror, Kind::Period, 6 + 1, 3), at(&all, Kind::Period, 4, 3));
    assert!(apart(at(&mirror, Kind::Orientation, 6 + 1, 3), -at(&all, Kind::Orientation, 4, 3)) < 1e-6);
    // Mirroring twice is a rotation by 180°, which leaves orientations unchanged.
    assert!(apart(at(&mirror, Kind::Orientation, 6 + 1, 4 + 1), at(&all, Kind::Orientation, 4, 2)) < 1e-6);
    let brick = edit(&all, &Options { size: Some([6, 8]), layout: Layout::Brick, ..Options::default() }).unwrap();
    assert_eq!(at(&brick, Kind::Period, 2, 4 + 2), at(&all, Kind::Period, 5, 2));
    let cropped = edit(&all, &Options { size: Some([3, 2]), ..Options::default() }).unwrap();
    assert!(at(&cropped, Kind::Period, 0, 0).is_nan());
}

#[test]
fn resampling_preserves_orientations() {
    let all = maps(60, 60);
    let coarse = edit(&all, &Options { resample: Some(0.5), ..Options::default() }).unwrap();
    assert_eq!([coarse.width, coarse.height], [30, 30]);
    assert_eq!(coarse.maps[&Kind::Period].attributes["pixel_um"], "25");
    let period = &coarse.maps[&Kind::Period];
    // The mean of columns 20 and 21.
    assert!((period.value[15 * 30 + 10] - (0.8 + 0.205)).abs() < 1e-6);
    // Averaging must not reduce σ.
    assert!(period.sigma[15 * 30 + 10] >= 0.002);
    let fine = edit(&all, &Options { resample: Some(3.0), ..Options::default() }).unwrap();
    let (w, map) = (fine.width, &fine.maps[&Kind::Orientation]);
    let (x, y) = (150.0 - 89.5, 89.5 - 40.0);
    assert!(apart(map.value[40 * w + 150], f32::atan2(y, x)) < 1e-3);
    // Across the wrap from 179° to 1°, the mean is 0°, not 90°.
    let seam: Vec<f32> = (0..16).map(|i| if i % 2 == 0 { 0.02 } else { PI - 0.02 }).collect();
    let map = Map {
        value: seam,
        sigma: vec![0.01; 16],
        mask: vec![1.0; 16],
        more: Default::default(),
        attributes: Default::default(),
    };
    let seam = Maps { width: 4, height: 4, maps: [(Kind::Orientation, map)].into() };
    let mean = edit(&seam, &Options { resample: Some(0.5), ..Options::default() }).unwrap();
    assert!(apart(mean.maps[&Kind::Orientation].value[0], 0.0) < 1e-3);
}

#[test]
fn periods_follow_curves_and_their_slopes() {
    let all = maps(64, 64);
    for (curve, at_90) in [(Curve::Quadratic([0.8, 1.6]), 1.0), (Curve::SineSquared([0.8, 1.6]), 1.2)] {
        assert!((curve.at(0.0).unwrap()[0] - 0.8).abs() < 1e-12);
        assert!((curve.at(std::f64::consts::FRAC_PI_2).unwrap()[0] - at_90).abs() < 1e-12);
        assert!((curve.at(std::f64::consts::PI).unwrap()[0] - 1.6).abs() < 1e-12);
        let [_, slope] = curve.at(1.1).unwrap();
        let rise = (curve.at(1.1 + 1e-6).unwrap()[0] - curve.at(1.1 - 1e-6).unwrap()[0]) / 2e-6;
        assert!((slope - rise).abs() < 1e-6);
        let new = edit(&all, &Options { period: Some(curve.clone()), ..Options::default() }).unwrap();
        let (orientation, period) = (&new.maps[&Kind::Orientation], &new.maps[&Kind::Period]);
        assert_eq!(orientation.mask, period.mask);
        let i = 20 * 64 + 50;
        let [um, slope] = curve.at(f64::from(orientation.value[i])).unwrap();
        assert_eq!(period.value[i], um as f32);
        assert!((f64::from(period.sigma[i]) - slope.abs() * f64::from(orientation.sigma[i])).abs() < 1e-9);
        assert!(period.attributes["made"].contains("not measured"));
    }
    let table = Curve::Table(vec![[0.0, 1.0], [90.0, 2.0], [120.0, 1.5]]);
    assert!((table.at(45.0_f64.to_radians()).unwrap()[0] - 1.5).abs() < 1e-12);
    assert_eq!(table.at(130.0_f64.to_radians()), None);
    let new = edit(&all, &Options { period: Some(table), ..Options::default() }).unwrap();
    let hidden = new.maps[&Kind::Orientation].known() - new.maps[&Kind::Period].known();
    assert!(hidden > 1000 && hidden < 1700, "{hidden}");
    let table = |rows: &[[f64; 2]]| Curve::Table(rows.to_vec());
    for wrong in [
        table(&[[0.0, 1.0]]),
        table(&[[90.0, 1.0], [0.0, 2.0]]),
        table(&[[0.0, 1.0], [1.0, f64::NAN]]),
        table(&[[0.0, 1.0], [200.0, 2.0]]),
        table(&[]),
        Curve::Quadratic([-1.0, 2.0]),
        Curve::SineSquared([1.0, f64::INFINITY]),
    ] {
        assert!(edit(&all, &Options { period: Some(wrong.clone()), ..Options::default() }).is_err(), "{wrong:?}");
    }
}

#[test]
fn periods_are_scaled_shifted_and_clamped_in_that_order() {
    let all = maps(50, 5);
    let edits = Options { scale: Some(2.0), offset_um: Some(-1.7), clamp_um: Some([0.05, 0.6]), ..Options::default() };
    let new = edit(&all, &edits).unwrap();
    let row = &new.maps[&Kind::Period].value[4 * 50..];
    assert!((row[10] - 0.1).abs() < 1e-6 && row[0] == 0.05 && row[49] == 0.6, "{row:?}");
    let sigma = [&new, &all].map(|m| m.maps[&Kind::Period].sigma[4 * 50 + 10]);
    assert!((sigma[0] - 2.0 * sigma[1]).abs() < 1e-9);
    // Without a clamp, periods of 0 or less are masked.
    let new = edit(&all, &Options { offset_um: Some(-1.0), ..Options::default() }).unwrap();
    let map = &new.maps[&Kind::Period];
    assert!(map.value[4 * 50 + 10].is_nan() && map.mask[4 * 50 + 10] == 0.0 && map.mask[4 * 50 + 49] == 1.0);
}

#[test]
fn edits_that_make_no_sense_are_refused() {
    let all = maps(5, 5);
    let mut period_only = all.clone();
    period_only.maps.remove(&Kind::Orientation);
    let quadratic = Curve::Quadratic([1.0, 2.0]);
    assert!(edit(&period_only, &Options { period: Some(quadratic), ..Options::default() }).is_err());
    for edits in [
        Options::default(),
        Options { rotate_deg: Some(f64::NAN), ..Options::default() },
        Options { resample: Some(0.0), ..Options::default() },
        Options { resample: Some(1000.0), tile: Some([10_000, 10_000]), ..Options::default() },
        Options { tile: Some([0, 1]), ..Options::default() },
        Options { tile: Some([usize::MAX, 2]), ..Options::default() },
        Options { size: Some([0, 5]), ..Options::default() },
        Options { size: Some([1 << 40, 1 << 40]), ..Options::default() },
        Options { clamp_um: Some([2.0, 1.0]), ..Options::default() },
        Options { scale: Some(-1.0), ..Options::default() },
        Options { offset_um: Some(f64::INFINITY), ..Options::default() },
    ] {
        assert!(edit(&all, &edits).is_err(), "{edits:?}");
    }
}

#[test]
fn maps_of_one_sample_are_laid_over_each_other() {
    // Uniform noise of 0.9 σ, and an analyser offset of 3°.
    let mut truth = maps(61, 47);
    truth.maps.get_mut(&Kind::Period).unwrap().sigma.fill(0.002);
    let noise = |i: usize| (((i * 7919) % 1009) as f32 / 1009.0 - 0.5) * 12_f32.sqrt();
    let mut other =
        edit(&truth, &Options { size: Some([50, 40]), orientation_offset_deg: Some(3.0), ..Options::default() });
    let map = other.as_mut().unwrap().maps.get_mut(&Kind::Period).unwrap();
    map.value.iter_mut().enumerate().for_each(|(i, v)| *v += 0.002 * noise(i));
    map.sigma.fill(0.002);
    let moved = other.unwrap().moved([-7, -5], [43, 35]).unwrap();
    let all = vec![("whole".to_owned(), truth.clone()), ("part".to_owned(), moved.clone())];
    let found = compare(all, true).unwrap();
    let part = &found.compared[1];
    assert_eq!(part.shift_px, [7, 5], "{part:?}");
    assert!(part.likeness > 0.9 && found.warnings.is_empty(), "{part:?} {:?}", found.warnings);
    let turned = part.orientation.as_ref().unwrap();
    assert!((turned.offset - 3.0).abs() < 1e-4 && turned.scatter < 1e-4, "{turned:?}");
    let period = part.period.as_ref().unwrap();
    assert!(period.offset.abs() < 1e-3 && period.pixels > 1300, "{period:?}");
    // The truth has an equal σ, so the combined σ is √2 larger; half of a uniform distribution lies within 0.866 of its
    // standard deviation, not 0.6745.
    assert!((period.sigmas.unwrap() - 0.866 / 0.6745 / 2.0_f64.sqrt()).abs() < 0.05, "{period:?}");
    assert_eq!(period.beyond, Some(0.0));
    assert_eq!([found.maps[1].1.width, found.maps[1].1.height], [61, 47]);
    // Any offset of all orientations leaves the shift as it is.
    let far = edit(&moved, &Options { orientation_offset_deg: Some(50.0), ..Options::default() }).unwrap();
    let found = compare(vec![("whole".to_owned(), truth.clone()), ("part".to_owned(), far)], true).unwrap();
    let part = &found.compared[1];
    assert!(part.shift_px == [7, 5] && part.likeness > 0.9, "{part:?}");
    assert!((part.orientation.as_ref().unwrap().offset - 53.0).abs() < 1e-4, "{part:?}");
    // Larger than the map used for coarse registration, with half the pixel size: the shift is found to the pixel.
    let large = maps(1300, 900);
    let fine = large.moved([-301, -222], [700, 500]).unwrap().resampled(2.0).unwrap();
    let found = compare(vec![("a".into(), large), ("b".into(), fine)], true).unwrap();
    assert_eq!(found.compared[1].shift_px, [301, 222]);
    assert!(found.compared[1].orientation.as_ref().unwrap().scatter < 0.05);
    // Without alignment, maps are not moved, and missing overlap is reported.
    assert_eq!(
        compare(vec![("a".into(), truth.clone()), ("b".into(), moved)], false).unwrap().compared[1].shift_px,
        [0, 0]
    );
    let mut periods = truth.clone();
    periods.maps.remove(&Kind::Orientation);
    let mut orientations = truth;
    orientations.maps.remove(&Kind::Period);
    let problem =
        compare(vec![("a".into(), periods.clone()), ("b".into(), orientations)], true).err().unwrap().to_string();
    assert!(problem.contains("nothing in common"), "{problem}");
    assert!(compare(vec![("a".into(), periods)], true).is_err());
}

#[test]
fn before_and_after_are_drawn() {
    let all = maps(300, 200);
    let curve = Curve::SineSquared([0.8, 1.6]);
    let new = edit(&all, &Options { rotate_deg: Some(30.0), period: Some(curve), ..Options::default() }).unwrap();
    let canvas = before_and_after(&all, &new, nacre_image::Palette::Cyclic, true);
    assert!(canvas.width > 900 && canvas.height > 500);
    if let Some(folder) = std::env::var_os("NACRE_PICTURES") {
        canvas.save_png(&std::path::PathBuf::from(folder).join("map-edit.png")).unwrap();
    }
}
