//! Tests of spectra per pixel against colours and closed forms, and of invalid requests.

use super::*;
use nacre_image::read_exr;
use nacre_optics::color::Observer;

/// A scene of a plane in front of the camera.
fn stage(material: &str, light: &str) -> String {
    format!(
        "[camera]\nposition = [0, 0, 200]\ntarget = [0, 0, 0]\nfov_deg = 30\nwidth = 12\nheight = 12\n[[shape]]\ntype = \"plane\"\n\
         size = [300, 300]\nmaterial = \"a\"\n{light}{material}"
    )
}

const LAMP: &str = "[[light]]\ntype = \"point\"\nposition = [60, 90, 150]\nsigma_mm = 4\nspectrum = \"A\"\n";
const WHITE: &str = "[material.a.base]\nalbedo = [0.8, 0.8, 0.8]\nroughness = 1\nspecular = [0, 0, 0]\n";
const GRATING: &str = "[material.a.diffraction]\ntype = \"grating\"\nperiod_um = 1.6\norientation_deg = 50\nrelief = { depth_um = 0.15 }\n\
                       coherence_um = 15\n";

fn spectral(step: f64, samples: usize) -> Settings {
    Settings { spectral_nm: Some(step), ..settings(samples, 1e-5) }
}

/// Linear sRGB of a pixel's spectrum: the trapezoid rule over its bands.
fn colors(picture: &Picture, pixel: usize) -> [f64; 3] {
    let step = picture.bands[1].nm - picture.bands[0].nm;
    let mut xyz = [0.0; 3];
    for (k, band) in picture.bands.iter().enumerate() {
        let end = if k == 0 || k + 1 == picture.bands.len() { 0.5 } else { 1.0 };
        let seen = Observer::Cie1931.at(band.nm);
        (0..3).for_each(|c| xyz[c] += f64::from(band.radiance[pixel]) * seen[c] * step * end);
    }
    nacre_optics::color::linear_srgb(xyz.map(|v| v as f32)).map(f64::from)
}

#[test]
fn spectra_add_up_to_the_colours() {
    let dir = tempfile::tempdir().unwrap();
    heights(dir.path());
    let top = |text: &str| format!("[material.a.diffraction]\n{text}\n");
    let field = top("type = \"heightfield\"\nfile = \"heights.exr\"\ncoherence_um = 20");
    let sky = "[[light]]\ntype = \"environment\"\ncolor = [0.9, 1, 0.6]\n";
    let disc = "[material.a.diffraction]\ntype = \"multislit\"\ndisc = true\n";
    let lattice = top("type = \"lattice\"\nperiod_um = [60, 80]\naperture_um = [20, 60]");
    // Material, light, samples per pixel, and the largest difference of a pixel relative to the brightest one.
    let cases = [
        (GRATING, LAMP, 16, 0.01),
        // Products of colours and of spectra agree under white light.
        ("[material.a.base]\nalbedo = [0.1, 0.4, 0.3]\n", &LAMP.replace("\"A\"", "\"D65\""), 16, 0.01),
        (disc, LAMP, 16, 0.01),
        (&lattice, &LAMP.replace("sigma_mm = 4", "sigma_mm = 0.3"), 4, 0.01),
        (&field, LAMP, 4, 0.01),
        (GRATING, sky, 64, 0.01),
        ("[material.a.base]\nalbedo = [0.5, 0.5, 0.5]\n", sky, 16, 0.01),
        // Directions are sampled independently for each group of three bands: pixels are noisy, and 64 samples left an
        // error of 0.1 to 1.5 % of the mean.
        (&field, sky, 32, 1.0),
    ];
    for (material, light, samples, allowed) in cases {
        // Bands of h nm see colours through colour matching functions smoothed by a triangle, an error of h²/12 times
        // their curvature. For a single lobe it is 0.5 % at 4 nm. Where pixels are noisy anyway, fewer bands suffice.
        let step = if allowed < 1.0 { 4.0 } else { 10.0 };
        let picture = picture(&stage(material, light), dir.path(), &spectral(step, samples));
        assert_eq!(picture.bands.len() as f64, 400.0 / step + 1.0);
        let found: Vec<[f64; 3]> = (0..picture.pixels.len()).map(|k| colors(&picture, k)).collect();
        let brightest = picture.pixels.iter().map(|p| p.luminance).fold(0.0, f64::max);
        let pairs = picture.pixels.iter().zip(&found);
        let worst = pairs.flat_map(|(p, f)| (0..3).map(|c| (p.rgb[c] - f[c]).abs())).fold(0.0, f64::max);
        assert!(brightest > 0.0 && worst < allowed * brightest, "{worst} of {brightest}\n{material}{light}");
        let whole = mean(&picture);
        for c in 0..3 {
            let sum: f64 = found.iter().map(|f| f[c]).sum();
            let off = (sum / found.len() as f64 - whole[c]).abs() / whole[1];
            assert!(off < if allowed < 1.0 { 4e-3 } else { 0.04 }, "{c}: {off}\n{material}{light}");
        }
    }
}

#[test]
fn a_lines_light_is_in_its_bands() {
    let line = LAMP.replace("spectrum = \"A\"", "spectrum = 600");
    let picture = picture(&stage(WHITE, &line), Path::new(""), &spectral(10.0, 16));
    let of = |nm: f64| f64::from(picture.bands.iter().find(|b| (b.nm - nm).abs() < 1e-9).unwrap().radiance[70]);
    let three = [590.0, 600.0, 610.0].map(of);
    // A light of luminance Y at 600 nm has the radiance Y/ȳ(600 nm).
    let radiance = picture.pixels[70].luminance / Observer::Cie1931.at(600.0)[1];
    assert!((three.iter().sum::<f64>() * 10.0 / radiance - 1.0).abs() < 2e-3, "{three:?} {radiance}");
    // The mean of |x| of a Gaussian of 0.85 nm is 0.678 nm, half of it on each side.
    assert!((three[0] / three[1] - 0.0339 / 0.9322).abs() < 2e-3, "{three:?}");
    assert_eq!([of(570.0), of(630.0), of(380.0), of(780.0)], [0.0; 4]);
}

#[test]
fn an_order_has_the_wavelength_of_the_grating_equation() {
    // Along the normal, the first order of 1.5 µm under light from sin θ = 0.36 is at 540 nm.
    let text = "[camera]\nposition = [0, 0, 1e4]\ntarget = [0, 0, 0]\nfov_deg = 0.01\nwidth = 1\nheight = 1\n[[shape]]\ntype = \"plane\"\n\
                size = [1e3, 1e3]\nmaterial = \"a\"\n[[light]]\ntype = \"directional\"\ndirection = [0.36, 0, 0.932952303175]\nspectrum = \"E\"\n\
                [material.a.diffraction]\ntype = \"grating\"\nperiod_um = 1.5\norientation_deg = 0\nrelief = { depth_um = 0.1 }\ncoherence_um = 60\n";
    let picture = picture(text, Path::new(""), &spectral(4.0, 4));
    let brightest = picture.bands.iter().max_by(|a, b| a.radiance[0].total_cmp(&b.radiance[0])).unwrap();
    assert_eq!(brightest.nm, 540.0);
    let mean = picture.bands.iter().map(|b| [b.nm * f64::from(b.radiance[0]), f64::from(b.radiance[0])]);
    let [sum, weight] = mean.fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d]);
    assert!((sum / weight - 540.0).abs() < 2.0, "{}", sum / weight);
}

#[test]
fn files_hold_spectra_as_others_read_them() {
    let dir = tempfile::tempdir().unwrap();
    let picture = picture(&stage(WHITE, LAMP), Path::new(""), &spectral(50.0, 16));
    let path = dir.path().join("a.exr");
    write_picture(&path, &picture).unwrap();
    let mut map = read_exr(&path).unwrap();
    assert_eq!(map.attributes.get("spectralLayoutVersion").map(String::as_str), Some("1.0"));
    assert!(map.attributes.contains_key("emissiveUnits"));
    for band in &picture.bands {
        assert_eq!(map.take(&format!("S0.{},000000nm", band.nm), &path).unwrap(), band.radiance);
    }
    // It is also a valid colour picture.
    assert_eq!(read_picture(&path).unwrap().width, 12);
}

#[test]
fn noise_is_reported_from_the_second_pass_on() {
    let scene = Scene::parse(&stage(GRATING, LAMP)).unwrap();
    let noise = |samples| {
        let (_, report) = render(&scene, Path::new(""), &spectral(50.0, samples), &Silent).unwrap();
        report.spectral.unwrap().noise
    };
    assert_eq!(noise(4), None);
    assert!(noise(8).is_some_and(|n| n > 1e-3));
}

#[test]
fn spectra_that_make_no_sense_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    table(dir.path());
    let refused = |text: &str, step: f64| {
        let scene = Scene::parse(text).unwrap();
        render(&scene, dir.path(), &spectral(step, 4), &Silent).unwrap_err().to_string()
    };
    for step in [0.5, 101.0, f64::NAN, -1.0] {
        assert!(refused(&stage(WHITE, LAMP), step).contains("1 to 100"));
    }
    let large = stage(WHITE, LAMP).replace("width = 12\nheight = 12", "width = 4000\nheight = 4000");
    assert!(refused(&large, 1.0).contains("fewer pixels"));
    let of_table = stage("[material.a.diffraction]\ntype = \"table\"\nfile = \"lut.exr\"\n", LAMP);
    assert!(refused(&of_table, 10.0).contains("material.a.diffraction"));
}
