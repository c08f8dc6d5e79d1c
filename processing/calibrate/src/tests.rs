//! Calibration of simulated photographs with known noise.

use super::camera::Options;
use nacre_base::operation::perform;
use nacre_base::progress::Silent;
use nacre_base::random::Stream;
use nacre_frames::{NoiseModel, Transfer};
use nacre_image::write_png16_gray;
use std::path::Path;

const SIDE: usize = 160;

/// Properties of a sensor.
#[derive(Clone, Copy)]
struct Sensor {
    /// DN per electron.
    gain: f64,
    read_noise_e: f64,
    full_well_e: f64,
    dark_e_s: f64,
    black_dn: f64,
    dsnu_e: f64,
    prnu: f64,
    /// Loss of response at full well.
    loss: f64,
}

const SENSOR: Sensor = Sensor {
    gain: 0.8,
    read_noise_e: 6.0,
    full_well_e: 30_000.0,
    dark_e_s: 40.0,
    black_dn: 240.0,
    dsnu_e: 3.0,
    prnu: 0.012,
    loss: 0.0,
};

/// A standard normal number.
fn normal(random: &mut Stream) -> f64 {
    (-2.0 * random.next().max(1e-300).ln()).sqrt() * (std::f64::consts::TAU * random.next()).cos()
}

/// Photographs of uneven light (0 for darkness) at each exposure, two of each.
fn photographs(sensor: Sensor, folder: &Path, light_e_s: f64, exposures_s: &[f64], seed: u64) {
    std::fs::create_dir_all(folder).unwrap();
    let (mut pattern, mut random) = (Stream::of(99), Stream::of(seed));
    let of_pixel: Vec<[f64; 2]> = (0..SIDE * SIDE).map(|_| [normal(&mut pattern), normal(&mut pattern)]).collect();
    let mut frames = vec![];
    for (k, exposure_s) in exposures_s.iter().flat_map(|e| [e, e]).enumerate() {
        let code = |i: usize, random: &mut Stream| {
            let (x, y) = ((i % SIDE) as f64 / SIDE as f64 - 0.5, (i / SIDE) as f64 / SIDE as f64 - 0.5);
            let shading = 1.0 - 0.4 * (x * x + y * y);
            let light = light_e_s * exposure_s * shading * (1.0 + sensor.prnu * of_pixel[i][0]);
            let dark = sensor.dark_e_s * exposure_s;
            // Two bad pixels: one hot, one dead.
            let (light, hot) = if i == 5000 { (0.0, 0.0) } else { (light, if i == 9000 { 900.0 } else { 0.0 }) };
            let mean = light + dark;
            let electrons = (mean + mean.sqrt() * normal(random)).min(sensor.full_well_e);
            let electrons = electrons + hot + sensor.dsnu_e * of_pixel[i][1] + sensor.read_noise_e * normal(random);
            let read = electrons * (1.0 - sensor.loss * electrons / sensor.full_well_e);
            (sensor.black_dn + sensor.gain * read).round().clamp(0.0, 65_535.0) as u16
        };
        let codes: Vec<u16> = (0..SIDE * SIDE).map(|i| code(i, &mut random)).collect();
        let file = format!("{k:02}.png");
        write_png16_gray(&folder.join(&file), SIDE, SIDE, &codes).unwrap();
        frames.push(serde_json::json!({ "file": file, "exposure_s": exposure_s }));
    }
    let set = serde_json::json!({ "kind": "exposures", "frames": frames, "transfer": "linear" });
    std::fs::write(folder.join("frames.json"), set.to_string()).unwrap();
}

const EXPOSURES_S: [f64; 9] = [0.001, 0.02, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4];

#[test]
fn a_sensor_is_measured_within_its_standard_deviations() {
    let seed = 7;
    println!("seed {seed}");
    let place = tempfile::tempdir().unwrap();
    let (flats, darks) = (place.path().join("flats"), place.path().join("darks"));
    photographs(SENSOR, &flats, 100_000.0, &EXPOSURES_S, seed);
    photographs(SENSOR, &darks, 0.0, &EXPOSURES_S, seed + 1);
    let options = Options { darks: Some(darks), channel: None };
    let report = perform(&options, &flats, &place.path().join("out"), false, &Silent).unwrap();
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    let found = &report.transfer;
    let gain = found.gain_dn_e;
    assert!((gain.value / SENSOR.gain - 1.0).abs() < 0.01, "{gain:?}");
    assert!((gain.value - SENSOR.gain).abs() < 3.0 * gain.sigma, "{gain:?}");
    let noise = found.read_noise_e;
    assert!((noise.value / SENSOR.read_noise_e - 1.0).abs() < 0.03, "{noise:?}");
    // The gain is off by up to 1 %, and the 90th percentile is above the mean by the noise of 7 electrons.
    assert!((found.full_well_e.unwrap() / SENSOR.full_well_e - 1.0).abs() < 0.011, "{:?}", found.full_well_e);
    // A mean over 25,600 pixels has 0.1 electrons of noise; the longest exposure is 0.4 s.
    let current = found.dark_current_e_s.unwrap();
    assert!((current.value - SENSOR.dark_e_s).abs() < 1.0, "{current:?}");
    assert!((found.black_dn - SENSOR.black_dn).abs() < 0.1, "{}", found.black_dn);
    assert!(found.linearity_error.unwrap() < 0.001, "{:?}", found.linearity_error);
    // Three standard deviations of the variance between 25,600 pixels, of which most is temporal noise.
    assert!((report.spatial.dsnu_e / SENSOR.dsnu_e - 1.0).abs() < 0.06, "{:?}", report.spatial);
    assert!((report.spatial.prnu / SENSOR.prnu - 1.0).abs() < 0.02, "{:?}", report.spatial);
    assert_eq!(report.spatial.bad_pixels, 2);
    let noise: NoiseModel = keys(&place.path().join("out"));
    assert!((noise.full_scale_e * gain.value + found.black_dn - found.saturation_dn).abs() < 1.0, "{noise:?}");
}

/// The true gain and noise are those at low light, where the loss vanishes.
#[test]
fn the_response_of_a_curved_sensor_is_measured_and_corrected() {
    let place = tempfile::tempdir().unwrap();
    let (flats, darks, out) = (place.path().join("flats"), place.path().join("darks"), place.path().join("out"));
    let sensor = Sensor { loss: 0.12, ..SENSOR };
    // Nine exposures below full well, and one beyond.
    let exposures_s: Vec<f64> = [0.001].into_iter().chain((1..=9).map(|k| 0.031 * f64::from(k))).chain([0.4]).collect();
    photographs(sensor, &flats, 100_000.0, &exposures_s, 5);
    photographs(sensor, &darks, 0.0, &exposures_s, 6);
    let options = Options { darks: Some(darks), channel: None };
    let report = perform(&options, &flats, &out, false, &Silent).unwrap();
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    let (found, response) = (&report.transfer, report.response.unwrap());
    assert!(response.deviation > 0.01 && found.linearity_error.unwrap() < 0.001, "{response:?} {found:?}");
    assert!((found.gain_dn_e.value / sensor.gain - 1.0).abs() < 0.01, "{:?}", found.gain_dn_e);
    assert!((found.read_noise_e.value / sensor.read_noise_e - 1.0).abs() < 0.03, "{:?}", found.read_noise_e);
    assert!((found.full_well_e.unwrap() / sensor.full_well_e - 1.0).abs() < 0.015, "{:?}", found.full_well_e);
    assert!((report.spatial.prnu / sensor.prnu - 1.0).abs() < 0.03, "{:?}", report.spatial);
    // Light that a frames.json with these keys decodes, relative to that at full well.
    let text = std::fs::read_to_string(out.join("noise.json")).unwrap();
    let keys: serde_json::Value = serde_json::from_str(&text).unwrap();
    let transfer: Transfer = serde_json::from_value(keys["transfer"].clone()).unwrap();
    let [black, white] = ["black", "white"].map(|key| keys[key].as_f64().unwrap());
    let decoded = |share: f64| {
        let dn = sensor.black_dn + sensor.gain * sensor.full_well_e * share * (1.0 - sensor.loss * share);
        f64::from(transfer.decode(((dn - black) / (white - black)) as f32))
    };
    for share in [0.1, 0.3, 0.6, 0.9] {
        let off = decoded(share) / decoded(0.5) / (2.0 * share) - 1.0;
        assert!(off.abs() < 0.003, "{share}: {off}");
    }
}

/// The noise of `noise.json`.
fn keys(out: &Path) -> NoiseModel {
    let text = std::fs::read_to_string(out.join("noise.json")).unwrap();
    serde_json::from_value(serde_json::from_str::<serde_json::Value>(&text).unwrap()["noise"].clone()).unwrap()
}

/// A `frames.json` states the electrons at gain 1, whatever the gain of the photographs.
#[test]
fn electrons_are_stated_at_gain_one() {
    let place = tempfile::tempdir().unwrap();
    let (flats, darks) = (place.path().join("flats"), place.path().join("darks"));
    photographs(SENSOR, &flats, 100_000.0, &[0.01, 0.1], 1);
    photographs(SENSOR, &darks, 0.0, &[0.1], 2);
    let measured = |name: &str| {
        let out = place.path().join(name);
        perform(&Options { darks: Some(darks.clone()), channel: None }, &flats, &out, false, &Silent).unwrap();
        keys(&out).full_scale_e
    };
    let at_one = measured("one");
    for folder in [&flats, &darks] {
        let path = folder.join("frames.json");
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(path, text.replace("\"file\"", "\"gain\":4,\"file\"")).unwrap();
    }
    assert!((measured("four") / at_one - 4.0).abs() < 1e-9);
}

#[test]
fn what_is_missing_is_named() {
    let place = tempfile::tempdir().unwrap();
    let (flats, darks) = (place.path().join("flats"), place.path().join("darks"));
    photographs(SENSOR, &flats, 100_000.0, &[0.01, 0.02], 1);
    photographs(SENSOR, &darks, 0.0, &[0.01], 2);
    let options = Options { darks: Some(darks), channel: None };
    let report = perform(&options, &flats, &place.path().join("out"), false, &Silent).unwrap();
    let found = &report.transfer;
    assert!(found.full_well_e.is_none() && found.dark_current_e_s.is_none() && found.linearity_error.is_none());
    assert!(report.warnings.iter().any(|w| w.contains("no photograph is saturated")), "{:?}", report.warnings);
    let refused = |options: &Options, input: &Path| {
        perform(options, input, &place.path().join("no"), false, &Silent).unwrap_err().to_string()
    };
    assert!(refused(&Options { channel: Some(2), ..options.clone() }, &flats).contains("channel"));
    assert!(refused(&Options { darks: None, channel: None }, &flats).contains("darks"));
    let nothing = Some(place.path().join("nothing"));
    assert!(refused(&Options { darks: nothing, channel: None }, &flats).contains("nothing"));
    std::fs::remove_file(flats.join("01.png")).unwrap();
    assert!(refused(&options, &flats).contains("01.png"));
}
