//! Pictures with a spectrum per pixel.
//!
//! A scene is rendered in three bands at a time, with the same passes as a colour picture; see [`Bands`].

use crate::light::viewer::Bands;
use crate::material::SAMPLES;
use crate::picture::{Band, Picture};
use crate::prepared_scene::PreparedScene;
use crate::scene::{Diffraction, Scene};
use crate::settings::Settings;
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_brdf::RANGE_NM;
use schemars::JsonSchema;
use serde::Serialize;
use std::path::Path;
use std::time::Instant;

/// Permitted band spacings in nm.
pub(crate) const STEPS_NM: [f64; 2] = [1.0, 100.0];

/// Maximum number of values over all bands: 1 GiB.
const MOST: usize = 256 << 20;

/// Report of the spectra.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct SpectralReport {
    /// Centres of the first and last band in nm.
    pub range_nm: [f64; 2],
    /// Spacing of the bands in nm.
    pub step_nm: f64,
    /// Number of bands.
    pub bands: usize,
    /// Maximum number of samples per pixel for three bands at a time.
    pub samples: usize,
    /// Largest noise over groups of three bands: root mean square of the standard errors of their mean, relative to the
    /// mean; `None` after a single pass.
    pub noise: Option<f64>,
    /// Computing time in s.
    pub seconds: f64,
}

/// Bands over the whole spectrum. The spacing is reduced slightly if it does not divide the range.
fn wavelengths(step_nm: f64) -> (f64, Vec<f64>) {
    let count = ((RANGE_NM[1] - RANGE_NM[0]) / step_nm).ceil().max(1.0);
    let step = (RANGE_NM[1] - RANGE_NM[0]) / count;
    (step, (0..=count as usize).map(|k| RANGE_NM[0] + step * k as f64).collect())
}

/// Refuses invalid band spacings, and materials without a spectrum.
pub(crate) fn check(scene: &Scene, step_nm: f64) -> Result<()> {
    if !(STEPS_NM[0]..=STEPS_NM[1]).contains(&step_nm) {
        let problem = format!("are {step_nm} nm apart");
        return Err(Error::input("spectral", problem, "give bands 1 to 100 nm apart"));
    }
    let values = wavelengths(step_nm).1.len().saturating_mul(scene.camera.width).saturating_mul(scene.camera.height);
    if values > MOST {
        let problem = format!("would have {values} values");
        return Err(Error::input("spectral", problem, format!("give fewer pixels or wider bands: at most {MOST}")));
    }
    for (name, material) in &scene.material {
        if matches!(material.diffraction, Some(Diffraction::Table { .. })) {
            let key = format!("material.{name}.diffraction");
            let remedy = "render it without spectra, or give it a grating, slits or a height field";
            return Err(Error::input(key, "is a table of colours, which has no spectrum", remedy));
        }
    }
    Ok(())
}

/// Renders a scene in bands, three at a time, until each group meets the target error.
pub(crate) fn spectra(
    mut prepared: PreparedScene,
    (scene, folder): (&Scene, &Path),
    step_nm: f64,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<(Vec<Band>, SpectralReport)> {
    let begun = Instant::now();
    let (step, nm) = wavelengths(step_nm);
    let most = (settings.samples / SAMPLES).max(1);
    progress.stage("bands", nm.len().div_ceil(3) as u64);
    let (mut bands, mut noise, mut passes) = (vec![], None, 0);
    for three in nm.chunks(3) {
        prepared.set_bands(scene, folder, Bands { first_nm: three[0], step_nm: step })?;
        let mut picture = Picture::new(prepared.size());
        while !picture.is_enough(most, settings.max_error, progress) {
            picture.add(&prepared, progress)?;
        }
        for (k, nm) in three.iter().enumerate() {
            bands.push(Band { nm: *nm, radiance: picture.pixels.iter().map(|p| p.rgb[k] as f32).collect() });
        }
        if picture.passes > 1 {
            noise = Some(picture.error().max(noise.unwrap_or(0.0)));
        }
        passes = passes.max(picture.passes);
        progress.step();
    }
    let report = SpectralReport {
        range_nm: RANGE_NM,
        step_nm: step,
        bands: nm.len(),
        samples: passes * SAMPLES,
        noise,
        seconds: begun.elapsed().as_secs_f64(),
    };
    Ok((bands, report))
}
