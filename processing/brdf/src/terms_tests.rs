//! Sets of terms: written, read, and compared with direct sums.

use super::height::{Shape, Synthetic};
use super::{HeightField, Method, Settings, TERMS_FILE, TermSet, Terms, TermsRequest};
use nacre_base::progress::Silent;
use nacre_image::{OutputFolder, Precision};
use std::fs;

fn fingers(depth_um: f64) -> HeightField {
    Synthetic { shape: Shape::Fingers, pixels: 96, pixel_um: 0.09, period_um: 1.2, depth_um, angle: 0.3 }
        .field()
        .unwrap()
}

const ALL: TermsRequest = TermsRequest { extent: 2.0, precision: None };

#[test]
fn a_set_that_was_read_again_is_as_exact_as_it_says() {
    let dir = tempfile::tempdir().unwrap();
    for (k, (depth, max_error, wanted)) in
        [(0.2, 0.01, None), (0.2, 0.2, None), (2.0, 0.01, None), (0.5, 0.01, Some(Precision::Half))]
            .into_iter()
            .enumerate()
    {
        let field = fingers(depth);
        let settings = Settings { max_error, coherence_um: 12.0, ..Settings::default() };
        let set = TermSet::new(&field, &settings, TermsRequest { precision: wanted, ..ALL }, &Silent).unwrap();
        let path = dir.path().join(k.to_string());
        let folder = OutputFolder::begin(&path, false).unwrap();
        set.write(&folder, &Silent).unwrap();
        folder.commit().unwrap();
        let read = Terms::read(&path).unwrap();
        let about = read.about().clone();
        assert_eq!(about, set.about);
        // Half precision meets large errors only.
        assert_eq!(about.precision == Precision::Half, max_error > 0.1 || wanted.is_some(), "{about:?}");
        let measured = read.measured(&field, 12.0).unwrap().unwrap();
        assert!(measured > 0.0 && measured <= about.predicted_error, "{depth}: {measured} {}", about.predicted_error);
        assert!(about.predicted_error <= max_error || wanted.is_some(), "{about:?}");
    }
}

#[test]
fn the_first_order_alone_is_right_for_shallow_surfaces_and_says_so_of_others() {
    let of = |depth: f64, order: usize| {
        let settings = Settings {
            method: Method::Taylor,
            order: Some(order),
            coherence_um: 12.0,
            max_error: 0.5,
            ..Settings::default()
        };
        let field = fingers(depth);
        let set = TermSet::new(&field, &settings, ALL, &Silent).unwrap();
        assert_eq!(set.about.terms, order + 1);
        let dir = tempfile::tempdir().unwrap();
        let folder = OutputFolder::begin(&dir.path().join("a"), false).unwrap();
        set.write(&folder, &Silent).unwrap();
        folder.commit().unwrap();
        let read = Terms::read(&dir.path().join("a")).unwrap();
        [read.measured(&field, 12.0).unwrap().unwrap(), set.about.predicted_error]
    };
    for depth in [0.01, 0.1] {
        let all = [1, 2, 5].map(|order| of(depth, order));
        assert!(all.iter().all(|[error, said]| *error <= *said && *error > 0.0), "{depth}: {all:?}");
        assert!(all[0][0] > all[1][0] && all[1][0] > all[2][0], "{depth}: {all:?}");
    }
    // 10 nm: X is at most 0.165, and the relative error of first-order lobes is about X²/2.
    assert!(of(0.01, 1)[0] < 0.05);
}

#[test]
fn what_is_no_set_is_refused() {
    let field = fingers(0.2);
    let refused = |settings: Settings, wanted: TermsRequest, words: &str| {
        let error = TermSet::new(&field, &settings, wanted, &Silent).err().unwrap().to_string();
        assert!(error.contains(words), "{error}");
    };
    let fft = Settings { method: Method::Fft, ..Settings::default() };
    refused(fft, ALL, "no real terms");
    refused(Settings { order: Some(1), ..Settings::default() }, ALL, "taylor");
    refused(Settings::default(), TermsRequest { extent: f64::NAN, ..ALL }, "extent");
    let dir = tempfile::tempdir().unwrap();
    assert!(Terms::read(dir.path()).is_err());
    let folder = OutputFolder::begin(&dir.path().join("a"), false).unwrap();
    TermSet::new(&field, &Settings::default(), ALL, &Silent).unwrap().write(&folder, &Silent).unwrap();
    folder.commit().unwrap();
    let path = dir.path().join("a").join(TERMS_FILE);
    let good = fs::read_to_string(&path).unwrap();
    for (from, to) in
        [("chebyshev", "cheb"), ("\"terms\": ", "\"terms\": 9"), ("\"half_um\": ", "\"half_um\": -"), ("{", "[")]
    {
        assert!(good.contains(from));
        fs::write(&path, good.replacen(from, to, 1)).unwrap();
        assert!(Terms::read(&dir.path().join("a")).is_err(), "{to}");
    }
    fs::write(&path, &good).unwrap();
    fs::write(dir.path().join("a/term_001.exr"), [0; 40]).unwrap();
    let error = Terms::read(&dir.path().join("a")).err().unwrap().to_string();
    assert!(error.contains("term_001.exr"), "{error}");
}
