//! Statistics against closed forms.

use super::*;
use nacre_image::write_exr;
use std::path::Path;

fn map(folder: &Path, name: &str, size: [usize; 2], value: &(dyn Fn(usize, usize) -> f32 + Sync)) -> Located {
    let fill = |_: usize, y: usize, row: &mut [f32]| row.iter_mut().enumerate().for_each(|(x, v)| *v = value(x, y));
    let channels: &[&str] = if name == "period" { &["period", "sigma"] } else { &["orientation"] };
    write_exr(&folder.join(format!("{name}.exr")), size[0], size[1], channels, &[], &fill).unwrap();
    locate(folder, name).unwrap()
}

fn region(query: RegionQuery, size: [usize; 2]) -> Region {
    Region::new(&query, size).unwrap()
}

fn polygon(text: &str) -> RegionQuery {
    RegionQuery { polygon: Some(text.into()), ..Default::default() }
}

#[test]
fn numbers_of_a_rectangle() {
    let folder = tempfile::tempdir().unwrap();
    let map = map(folder.path(), "period", [20, 10], &|x, y| if x == 4 { f32::NAN } else { (y * 20 + x) as f32 });
    let query = RegionQuery { x: Some(3), y: Some(2), w: Some(4), h: Some(2), ..Default::default() };
    let found = statistics_of(&map, &region(query, map.size), 4).unwrap();
    assert_eq!((found.pixels, found.step, found.read, found.valid), (8, 1, 8, 6));
    // 43, 45, 46, 63, 65, 66.
    assert_eq!((found.min, found.max, found.percentiles[4].value), (Some(43.0), Some(66.0), 54.5));
    assert!((found.mean.unwrap() - 328.0 / 6.0).abs() < 1e-9);
    let histogram = found.histogram.unwrap();
    assert_eq!(histogram.counts.iter().sum::<u64>(), 4, "the ends lie beyond 0.1 %");
    let all = statistics_of(&map, &region(RegionQuery::default(), map.size), 16).unwrap();
    assert_eq!((all.pixels, all.valid), (200, 190));
}

#[test]
fn large_regions_are_sampled_evenly() {
    let folder = tempfile::tempdir().unwrap();
    let map = map(folder.path(), "period", [2000, 1100], &|x, y| (x + y) as f32);
    let found = statistics_of(&map, &region(RegionQuery::default(), map.size), 8).unwrap();
    assert_eq!((found.pixels, found.step, found.read), (2_200_000, 2, 550_000));
    assert!((found.mean.unwrap() - (999.0 + 549.0)).abs() < 0.5, "{:?}", found.mean);
}

#[test]
fn polygons_hold_the_pixels_whose_centre_is_inside() {
    let square = region(polygon("2.5,1.5,6.5,1.5,6.5,4.5,2.5,4.5"), [20, 10]);
    assert_eq!((square.pixels(), square.rows.clone()), (12, 2..5));
    assert_eq!(square.spans(3), vec![3..7]);
    // A right triangle of 10 by 10 pixels, without its hypotenuse.
    let triangle = region(polygon("-0.5,-0.5,9.4,-0.5,-0.5,9.4"), [20, 20]);
    assert_eq!(triangle.pixels(), 45);
    // Partly and wholly outside of the map.
    assert_eq!(region(polygon("-9,-9,3.5,-9,3.5,3.5,-9,3.5"), [20, 10]).pixels(), 16);
    assert_eq!(region(polygon("30,30,40,30,40,40"), [20, 10]).pixels(), 0);
    for text in ["", "1,2,3,4", "1,2,3,4,5", "1,2,3,4,5,x", "1,2,3,4,5,inf", "1,2,3,4,5,1e9", &"1,2,".repeat(65)] {
        assert!(Region::new(&polygon(text), [20, 10]).is_err(), "{text}");
    }
    let both = RegionQuery { x: Some(1), ..polygon("0,0,9,0,9,9") };
    assert!(Region::new(&both, [20, 10]).is_err());
    let beyond = RegionQuery { x: Some(20), ..Default::default() };
    assert!(Region::new(&beyond, [20, 10]).is_err());
}

#[test]
fn directions_are_averaged_on_the_circle() {
    let folder = tempfile::tempdir().unwrap();
    let pi = std::f32::consts::PI;
    let map = map(folder.path(), "orientation", [10, 10], &|x, _| if x % 2 == 0 { 0.1 } else { pi - 0.1 });
    let found = statistics_of(&map, &region(RegionQuery::default(), map.size), 10).unwrap();
    let mean = found.mean.unwrap();
    assert!(mean.min(PI - mean) < 1e-6, "{mean}");
    // Two values ± 0.1: R = cos 0.2.
    assert!((found.sd.unwrap() - 0.5 * (-2.0 * 0.2_f64.cos().ln()).sqrt()).abs() < 1e-6);
    assert!(found.percentiles.is_empty());
    let histogram = found.histogram.unwrap();
    assert_eq!((histogram.counts[0], histogram.counts[9], histogram.high), (50, 50, PI));
}

#[test]
fn nothing_valid_has_no_statistics() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["orientation", "period"] {
        let map = map(folder.path(), name, [5, 5], &|_, _| f32::NAN);
        let found = statistics_of(&map, &region(RegionQuery::default(), map.size), 10).unwrap();
        assert_eq!((found.read, found.valid), (25, 0));
        assert!(found.min.is_none() && found.mean.is_none() && found.sd.is_none() && found.histogram.is_none());
    }
}

#[test]
fn profiles_read_the_nearest_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let map = map(folder.path(), "period", [20, 10], &|x, y| if x == 4 { f32::NAN } else { (y * 20 + x) as f32 });
    assert_eq!(map.sigma.as_deref(), Some("period_sigma"));
    let line = |x0, y0, x1, y1| points(&LineQuery { x0, y0, x1, y1 }, map.size);
    let down = line(3.0, 2.0, 5.0, 6.0).unwrap();
    assert_eq!(down, [[3, 2], [4, 3], [4, 4], [5, 5], [5, 6]]);
    assert_eq!(along(&map, &down).unwrap(), [Some(43.0), None, None, Some(105.0), Some(125.0)]);
    assert_eq!(line(2.0, 2.0, 2.0, 2.0).unwrap().len(), 2);
    for outside in [line(20.0, 0.0, 1.0, 1.0), line(0.0, -1.0, 1.0, 1.0), line(0.0, 0.0, f64::NAN, 1.0)] {
        assert!(outside.is_err());
    }
    assert!(points(&LineQuery { x0: 0.0, y0: 0.0, x1: 60_000.0, y1: 0.0 }, [65_000, 2]).unwrap().len() <= MOST_POINTS);
}
