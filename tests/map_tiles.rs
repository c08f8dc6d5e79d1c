//! Tiles, statistics and profiles of maps over REST, compared with the numbers of the files.

#![allow(clippy::unwrap_used)]

use nacre_tests::Place;
use nacre_tests::http::{Service, begin, finished, plan};
use serde_json::{Value, json};
use std::f64::consts::PI;

/// A session of a simulated sample; the path of its results.
fn result(service: &Service) -> String {
    let id = begin(service, &plan(4, 10.0));
    finished(service, &id);
    service.until(&format!("/api/v1/sessions/{id}"), |s| s["has_results"] == true);
    format!("/api/v1/reconstructions/{id}")
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
}

/// All values of a map, from its NumPy array.
fn values(service: &Service, base: &str, map: &str, count: usize) -> Vec<f32> {
    let array = service.get(&format!("{base}/maps/{map}.npy")).expect(200).body;
    floats(&array[array.len() - 4 * count..])
}

#[test]
fn tiles_and_statistics_agree_with_the_files() {
    let place = Place::with_bench("", "camera = { width = 300, height = 280 }");
    let service = Service::start(&place, &[]);
    let base = result(&service);
    let maps = service.get(&format!("{base}/maps")).expect(200).json();
    let named = |name: &str| maps.as_array().unwrap().iter().find(|m| m["name"] == name).unwrap().clone();
    let orientation = named("orientation");
    assert_eq!(
        [&orientation["width"], &orientation["height"], &orientation["levels"]],
        [&json!(300), &json!(280), &json!(2)]
    );
    assert_eq!([&orientation["kind"], &orientation["unit"]], [&json!("direction"), &json!("rad")]);
    assert_eq!(orientation["sigma"], "sigma");
    assert_eq!(named("mask")["kind"], "mask");
    // Maps without a name of their own have that of file and channel.
    assert_eq!(named("stokes.S1")["width"], 300);

    let all = values(&service, &base, "orientation", 300 * 280);
    for (column, row, width, height) in [(0, 0, 256, 256), (1, 0, 44, 256), (0, 1, 256, 24), (1, 1, 44, 24)] {
        let tile = floats(&service.get(&format!("{base}/tiles/orientation/0/{column}/{row}")).expect(200).body);
        assert_eq!(tile.len(), width * height);
        for (k, v) in tile.iter().enumerate() {
            let [x, y] = [256 * column + k % width, 256 * row + k / width];
            assert_eq!(v.to_bits(), all[300 * y + x].to_bits(), "{x}, {y}");
        }
    }
    let s0 = values(&service, &base, "s0", 300 * 280);
    let half = floats(&service.get(&format!("{base}/tiles/s0/1/0/0")).expect(200).body);
    assert_eq!(half.len(), 150 * 140);
    let mean = 0.25 * (s0[2 * 300 + 4] + s0[2 * 300 + 5] + s0[3 * 300 + 4] + s0[3 * 300 + 5]);
    assert!((half[150 + 2] / mean - 1.0).abs() < 1e-5, "{} {mean}", half[152]);

    let found = service.get(&format!("{base}/statistics/s0?x=10&y=20&w=100&h=50&bins=32")).expect(200).json();
    let part: Vec<f64> = (20..70).flat_map(|y| (10..110).map(move |x| 300 * y + x)).map(|i| f64::from(s0[i])).collect();
    let mean = part.iter().sum::<f64>() / 5000.0;
    let sd = (part.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 5000.0).sqrt();
    assert_eq!([&found["pixels"], &found["step"], &found["valid"]], [&json!(5000), &json!(1), &json!(5000)]);
    let number = |key: &str| found[key].as_f64().unwrap();
    assert!((number("mean") / mean - 1.0).abs() < 1e-6 && (number("sd") / sd - 1.0).abs() < 1e-5, "{found}");
    assert_eq!(found["histogram"]["counts"].as_array().unwrap().len(), 32);

    let line = service.get(&format!("{base}/profile/orientation?x0=10&y0=30&x1=29&y1=30")).expect(200).json();
    let sigma = values(&service, &base, "sigma", 300 * 280);
    for (k, x) in (10..30).enumerate() {
        let same = |found: &Value, of: f32| found.as_f64().map(|v| v as f32) == Some(of).filter(|v| v.is_finite());
        assert!(same(&line["value"][k], all[300 * 30 + x]) && same(&line["sigma"][k], sigma[300 * 30 + x]), "{line}");
    }
    assert_eq!([&line["length_px"], &line["x"][19]], [&json!(19.0), &json!(29)]);

    let polygon =
        service.get(&format!("{base}/statistics/orientation?polygon=-0.5,-0.5,99.5,-0.5,99.5,99.5,-0.5,99.5"));
    let polygon = polygon.expect(200).json();
    let square = service.get(&format!("{base}/statistics/orientation?w=100&h=100")).expect(200).json();
    assert_eq!(polygon, square);
    assert_eq!(square["histogram"]["high"].as_f64(), Some(PI));
}

#[test]
fn requests_beyond_a_map_are_refused_in_its_terms() {
    let place = Place::with_bench("", "camera = { width = 64, height = 48 }");
    let service = Service::start(&place, &[]);
    let base = result(&service);
    for (path, status, words) in [
        ("tiles/orientation/1/0/0", 404, "give a level from 0 to 0"),
        ("tiles/orientation/0/1/0", 404, "1 columns and 1 rows of tiles"),
        ("tiles/orientation/0/0/4294967295", 404, "tiles, counted from 0"),
        ("tiles/nothing/0/0/0", 404, "maps lists the maps"),
        ("tiles/..%2Fsession.S0/0/0/0", 404, "maps lists the maps"),
        ("tiles/orientation/-1/0/0", 404, ""),
        ("statistics/s0?x=64", 400, "holds no pixel of the map, which is 64 × 48"),
        ("statistics/s0?bins=1", 400, "give 2 to 512"),
        ("statistics/s0?polygon=1,2", 400, "3 to 64 corners"),
        ("statistics/s0?polygon=0,0,9,0,9,9&x=1", 400, "together with"),
        ("statistics/s0?colour=red", 400, "colour"),
        ("profile/s0?x0=0&y0=0&x1=64&y1=0", 400, "give 0 to 63"),
        ("profile/s0?x0=0&y0=0&x1=nan&y1=0", 400, "x1 is NaN"),
        ("profile/s0?x0=0", 400, "y0"),
    ] {
        let answer = service.get(&format!("{base}/{path}")).expect(status);
        assert_eq!(answer.header("content-type").as_deref(), Some("application/problem+json"), "{path}");
        let text = answer.text();
        assert!(text.contains(words) && !text.contains("/data/"), "{path}: {text}");
    }
}
