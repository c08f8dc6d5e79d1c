//! Small text files: spectra, curves, responses, calibrations, packs of maps, sets of terms. The first byte selects
//! one.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_brdf::{Section, TERMS_FILE, Terms};
use nacre_frames::hdr::Response;
use nacre_lut::bokeh::Calibration;
use nacre_maps::{Curve, PACK};
use nacre_optics::color::Spectrum;
use nacre_polarimetry::AppliedCorrections;

fuzz_target!(|bytes: &[u8]| {
    let Some((choice, text)) = bytes.split_first() else { return };
    let file = |name: &str| nacre_fuzz::file(name, text);
    match choice % 9 {
        0 => _ = Spectrum::read(&file("spectrum.csv")),
        1 => _ = Section::read(&file("section.csv"), 2.0).map(|s| format!("{s:?}")),
        2 => _ = Curve::read(&file("curve.csv")).map(|c| c.at(1.0)),
        3 => _ = Response::read(&file("response.json")),
        4 => _ = Calibration::read(&file("calibration.json")),
        5 => _ = Calibration::read(&file("calibration.toml")),
        6 => _ = nacre_maps::import(&file(PACK)),
        7 => _ = Terms::read(file(TERMS_FILE).parent().unwrap_or(nacre_fuzz::folder())),
        _ => _ = AppliedCorrections::read(file("report.json").parent().unwrap_or(nacre_fuzz::folder())),
    }
});
