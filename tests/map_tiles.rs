//! Tiles, statistics and profiles of maps over REST, compared with the numbers of the files.

#![allow(clippy::unwrap_used)]

use nacre_processing::image::{Attribute, write_exr};
use nacre_tests::Place;
use nacre_tests::http::Service;
use serde_json::{Value, json};
use std::f32::consts::PI;

/// Width and height of the maps.
pub const SIZE: [usize; 2] = [300, 280];

/// A result with maps of orientation and period, their σ and mask, and a masked disc; `offset` is added to the
/// orientations. Answers with its id.
pub fn maps(place: &Place, service: &Service, offset: f32) -> String {
    let [width, height] = SIZE;
    let masked = |x: usize, y: usize| (x as f32 - 60.0).hypot(y as f32 - 200.0) < 25.0;
    let write = |name: &str, units: &str, value: &(dyn Fn(usize, usize) -> [f32; 2] + Sync)| {
        let attributes = [("units", Attribute::Text(units.into())), ("pixel_um", Attribute::Number(12.5))];
        let path = place.path(&format!("{name}.exr"));
        let fill = |c: usize, y: usize, row: &mut [f32]| {
            for (x, v) in row.iter_mut().enumerate() {
                let hidden = masked(x, y);
                *v = if c == 2 {
                    f32::from(u8::from(!hidden))
                } else if hidden {
                    f32::NAN
                } else {
                    value(x, y)[c]
                };
            }
        };
        write_exr(&path, width, height, &[name, "sigma", "mask"], &attributes, &fill).unwrap();
        std::fs::read(path).unwrap()
    };
    let orientation = write("orientation", "orientation, sigma: rad", &|x, y| {
        [(0.004 * x as f32 + 0.003 * y as f32 + offset).rem_euclid(PI), 0.002 + 1e-5 * x as f32]
    });
    let period = write("period", "period, sigma: um", &|x, y| {
        [1.2 + 0.001 * x as f32 + 0.0002 * ((7 * x + 13 * y) % 11) as f32, 0.01 + 1e-5 * y as f32]
    });
    let parts: [(&str, &str, &[u8]); 3] =
        [("kind", "", b"maps"), ("file", "orientation.exr", &orientation), ("file", "period.exr", &period)];
    let upload = service.upload(&parts).expect(201).json()["id"].clone();
    let order = json!({ "upload": upload, "method": "map", "options": { "rotate_deg": 180 } });
    let id = service.post("/api/v1/reconstructions", &order).expect(202).json()["id"].as_str().unwrap().to_owned();
    let path = format!("/api/v1/reconstructions/{id}");
    let done = service.until(&path, |j| j["state"] != "queued" && j["state"] != "running");
    assert_eq!(done["state"], "done", "{done}");
    id
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
    let place = Place::with_bench("", "camera = { width = 64, height = 48 }");
    let service = Service::start(&place, &[]);
    let base = format!("/api/v1/reconstructions/{}", maps(&place, &service, 0.0));
    let listed = service.get(&format!("{base}/maps")).expect(200).json();
    let named = |name: &str| listed.as_array().unwrap().iter().find(|m| m["name"] == name).unwrap().clone();
    let orientation = named("orientation");
    assert_eq!(
        [&orientation["width"], &orientation["height"], &orientation["levels"]],
        [&json!(300), &json!(280), &json!(2)]
    );
    assert_eq!([&orientation["kind"], &orientation["unit"]], [&json!("direction"), &json!("rad")]);
    assert_eq!(orientation["sigma"], "sigma");
    assert_eq!(named("mask")["kind"], "mask");
    // Maps without a name of their own have that of file and channel.
    assert_eq!([&named("period.mask")["width"], &named("period")["unit"]], [&json!(300), &json!("um")]);
    assert_eq!([&named("period")["sigma"], &named("period")["pixel_um"]], [&json!("period_sigma"), &json!(12.5)]);

    let all = values(&service, &base, "orientation", 300 * 280);
    for (column, row, width, height) in [(0, 0, 256, 256), (1, 0, 44, 256), (0, 1, 256, 24), (1, 1, 44, 24)] {
        let tile = floats(&service.get(&format!("{base}/tiles/orientation/0/{column}/{row}")).expect(200).body);
        assert_eq!(tile.len(), width * height);
        for (k, v) in tile.iter().enumerate() {
            let [x, y] = [256 * column + k % width, 256 * row + k / width];
            assert_eq!(v.to_bits(), all[300 * y + x].to_bits(), "{x}, {y}");
        }
    }
    let period = values(&service, &base, "period", 300 * 280);
    let half = floats(&service.get(&format!("{base}/tiles/period/1/0/0")).expect(200).body);
    assert_eq!(half.len(), 150 * 140);
    let mean = 0.25 * (period[2 * 300 + 4] + period[2 * 300 + 5] + period[3 * 300 + 4] + period[3 * 300 + 5]);
    assert!((half[150 + 2] / mean - 1.0).abs() < 1e-5, "{} {mean}", half[152]);

    let found = service.get(&format!("{base}/statistics/period?x=10&y=20&w=100&h=50&bins=32")).expect(200).json();
    let part: Vec<f64> =
        (20..70).flat_map(|y| (10..110).map(move |x| 300 * y + x)).map(|i| f64::from(period[i])).collect();
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
    assert_eq!(square["histogram"]["high"].as_f64(), Some(std::f64::consts::PI));
}

/// A map above 64 Mpixel: tiles and pictures take little memory.
#[test]
fn large_maps_are_read_by_tiles() {
    let place = Place::with_bench("", "camera = { width = 64, height = 48 }");
    let service = Service::start(&place, &[]);
    let id = maps(&place, &service, 0.0);
    let base = format!("/api/v1/reconstructions/{id}");
    let side = 8300;
    let fill = |_: usize, y: usize, row: &mut [f32]| row.fill((y / 64) as f32 * 0.01);
    let file = place.path(&format!("data/reconstructions/{id}/orientation.exr"));
    write_exr(&file, side, side, &["orientation"], &[], &fill).unwrap();
    let before = service.memory();
    let listed = service.get(&format!("{base}/maps")).expect(200).json();
    assert!(listed.as_array().unwrap().iter().any(|m| m["name"] == "orientation" && m["width"] == side), "{listed}");
    let last = (side - 1) / 256;
    let tile = floats(&service.get(&format!("{base}/tiles/orientation/0/{last}/{last}")).expect(200).body);
    assert_eq!((tile.len(), tile[0]), (108 * 108, (last * 256 / 64) as f32 * 0.01));
    let all = floats(&service.get(&format!("{base}/tiles/orientation/3/0/0")).expect(200).body);
    assert!((all[256 * 50] - 0.06).abs() < 1e-3, "{}", all[256 * 50]);
    service.get(&format!("{base}/maps/orientation.png?width=192")).expect(200);
    let grown = service.memory().saturating_sub(before) >> 10;
    assert!(grown < 128, "{grown} MiB");
}

#[test]
fn requests_beyond_a_map_are_refused_in_its_terms() {
    let place = Place::with_bench("", "camera = { width = 64, height = 48 }");
    let service = Service::start(&place, &[]);
    let base = format!("/api/v1/reconstructions/{}", maps(&place, &service, 0.0));
    for (path, status, words) in [
        ("tiles/orientation/2/0/0", 404, "give a level from 0 to 1"),
        ("tiles/orientation/0/2/0", 404, "2 columns and 2 rows of tiles"),
        ("tiles/orientation/0/0/4294967295", 404, "tiles, counted from 0"),
        ("tiles/nothing/0/0/0", 404, "maps lists the maps"),
        ("tiles/..%2Fsession.S0/0/0/0", 404, "maps lists the maps"),
        ("tiles/orientation/-1/0/0", 404, ""),
        ("statistics/period?x=300", 400, "holds no pixel of the map, which is 300 × 280"),
        ("statistics/period?bins=1", 400, "give 2 to 512"),
        ("statistics/period?polygon=1,2", 400, "3 to 64 corners"),
        ("statistics/period?polygon=0,0,9,0,9,9&x=1", 400, "together with"),
        ("statistics/period?colour=red", 400, "colour"),
        ("profile/period?x0=0&y0=0&x1=300&y1=0", 400, "give 0 to 299"),
        ("profile/period?x0=0&y0=0&x1=nan&y1=0", 400, "x1 is NaN"),
        ("profile/period?x0=0", 400, "y0"),
    ] {
        let answer = service.get(&format!("{base}/{path}")).expect(status);
        assert_eq!(answer.header("content-type").as_deref(), Some("application/problem+json"), "{path}");
        let text = answer.text();
        assert!(text.contains(words) && !text.contains("/data/"), "{path}: {text}");
    }
}
