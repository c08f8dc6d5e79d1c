//! Tests of the predicted σ during a series against the final one.

use crate::reconstruct;
use crate::tests::bracket::{CAMERA, EXPOSURES, photograph, write_set};
use crate::{Model, Options, Running};
use nacre_base::progress::Silent;
use nacre_frames::load;
use nacre_image::OutputFolder;
use std::f64::consts::{FRAC_PI_4, PI};
use std::path::Path;

/// Adds the photographs at the first `angles` angles, `per` at each, as a session does.
fn running(folder: &Path, angles: usize, per: usize) -> Running {
    let mut frames = load(folder).unwrap();
    let rest = frames.set.frames.split_off(per);
    let mut running = Running::open(frames).unwrap();
    running.add().unwrap();
    for photographs in rest.chunks(per).take(angles - 1) {
        running.push(photographs.to_vec()).unwrap();
        running.add().unwrap();
    }
    running
}

/// An incrementally added series gives the same bytes as the whole set, and its σ matches the report.
#[test]
fn a_series_that_grows_gives_the_same_maps_as_the_whole() {
    for exposures in [&EXPOSURES[..1], &EXPOSURES[..]] {
        let folder = tempfile::tempdir().unwrap();
        photograph(folder.path(), 6, exposures, Some(CAMERA));
        let options = Options { model: Some(Model::Sinusoid), ..Options::default() };
        let (whole, grown) = (folder.path().join("whole"), folder.path().join("grown"));
        let report = reconstruct(folder.path(), &whole, &options, &Silent).unwrap();
        let running = running(folder.path(), 6, exposures.len());
        let precision = running.precision().unwrap();
        let (predicted, is) = (precision.sigma().unwrap().to_degrees(), report.pixels.sigma_p90_deg.unwrap());
        assert!((predicted / is - 1.0).abs() < 1e-6 && precision.is_certain(), "{predicted} {is}");
        let grown_folder = OutputFolder::begin(&grown, false).unwrap();
        running.finish(&grown_folder, &options, &Silent).unwrap();
        grown_folder.commit().unwrap();
        for file in ["orientation.exr", "stokes.exr"] {
            let [a, b] = [&whole, &grown].map(|f| std::fs::read(f.join(file)).unwrap());
            assert!(a == b, "{file}");
        }
    }
}

/// The lower bound of σ does not exceed the final σ; for bright pixels it agrees to 10 %.
#[test]
fn the_predicted_sigma_comes_true() {
    let folder = tempfile::tempdir().unwrap();
    photograph(folder.path(), 24, &[0.02], Some(CAMERA));
    let mut set = load(folder.path()).unwrap().set;
    // The first four angles are equidistant.
    set.frames.sort_by_key(|f| (f.analyser_deg.unwrap() % 45.0 > 0.01, f.file.clone()));
    write_set(folder.path(), &set);
    for (rows, least) in [([0, 64], 0.6), ([0, 32], 0.9)] {
        crop(folder.path(), rows);
        let predicted = running(folder.path(), 4, 1).precision().unwrap().least_sigma_after(24).unwrap();
        let is = running(folder.path(), 24, 1).precision().unwrap().sigma().unwrap();
        assert!((least..1.1).contains(&(predicted / is)), "{predicted} {is}");
    }
}

/// Keeps only a range of rows of the photographs.
fn crop(folder: &Path, [from, to]: [u32; 2]) {
    for frame in &load(folder).unwrap().set.frames {
        let path = folder.join(&frame.file);
        let whole = image::open(&path).unwrap().into_luma16();
        image::imageops::crop_imm(&whole, 0, from, whole.width(), to - from).to_image().save(&path).unwrap();
    }
}

/// With one orientation in view the steepest point of its sinusoid is best; with all orientations, the largest gap.
#[test]
fn the_next_angle_is_where_the_sinusoid_is_steepest() {
    let grid: Vec<f64> = (0..180).map(|k| f64::from(k).to_radians()).collect();
    for per in [1, 3] {
        let folder = tempfile::tempdir().unwrap();
        photograph(folder.path(), 4, &EXPOSURES[..per], Some(CAMERA));
        let all = running(folder.path(), 4, per).precision().unwrap();
        let best = all.best_angle(&grid).unwrap();
        assert!(grid.contains(&best));
        assert!(all.best_angle(&[]).is_none());
        // The rows of one brightness and orientation.
        crop(folder.path(), [32, 40]);
        let one = running(folder.path(), 4, per).precision().unwrap();
        let best = one.best_angle(&grid).unwrap();
        let aolp = crate::tests::bracket::scene(32).1;
        // At half height, or slightly darker, where shot noise is lower.
        let from_steepest = ((best - aolp).rem_euclid(PI / 2.0) - FRAC_PI_4).abs();
        assert!(from_steepest < 12f64.to_radians(), "{} from {}", best.to_degrees(), aolp.to_degrees());
        assert!(best < PI);
    }
}

#[test]
fn precision_requires_enough_angles() {
    let folder = tempfile::tempdir().unwrap();
    photograph(folder.path(), 6, &[0.02], None);
    assert!(running(folder.path(), 2, 1).precision().is_err());
    let three = running(folder.path(), 3, 1).precision().unwrap();
    assert!(!three.is_certain(), "three angles leave no residual");
    assert!(running(folder.path(), 4, 1).precision().unwrap().is_certain());
}
