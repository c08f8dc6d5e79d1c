//! Steps between the fit and its solution: usable light, its noise, and uneven illumination.

use crate::angles::aligned::smoothed_noise;
use crate::angles::repeats::{calibrate, pairs};
use crate::angles::sample::Sample;
use crate::fit::bracket::noise_of_bracket;
use crate::fit::demosaic::Demosaic;
use crate::fit::flat::Flat;
use crate::fit::merge::Merge;
use crate::fit::views::View;
use crate::fit::weighted::{scale_variances, variance_factor};
use crate::{Design, FrameNoise, NoiseSource, StokesMaps, estimate_noise};
use nacre_base::{Error, Result};
use nacre_frames::{Linearizer, LoadedFrames};

/// Refuses sets without any usable pixel.
pub(super) fn check_light(frames: &LoadedFrames, maps: &StokesMaps, linearizer: &Linearizer) -> Result<()> {
    let usable = maps.s0.iter().filter(|v| v.is_finite()).count();
    if usable == 0 {
        return Err(Error::file(
            &frames.path,
            "every pixel is saturated at one angle at least",
            "expose less, or correct \"white\"",
        ));
    }
    let scale = frames.set.frames.iter().map(|f| f.scale()).fold(f64::INFINITY, f64::min);
    let one_code = (linearizer.step() * scale) as f32;
    if !maps.s0.iter().any(|&s0| 0.5 * s0 > one_code) {
        return Err(Error::file(
            &frames.path,
            "no pixel is brighter than black in these photographs",
            "expose longer, or correct \"black\"",
        ));
    }
    Ok(())
}

/// The added photographs.
pub(super) struct Photographed<'a> {
    pub frames: &'a LoadedFrames,
    pub linearizer: &'a Linearizer,
    pub brackets: &'a [Vec<usize>],
    pub views: &'a [View],
    pub sample: &'a Sample,
    pub demosaic: Demosaic,
    /// Corrected shifts in pixels, whose correction smooths.
    pub shifts: Option<&'a [[f64; 2]]>,
}

/// Noise of every view: as given, from repeats, from the residuals, or assumed. Maps of merged exposures have their own
/// variances, which are scaled by the residuals if no noise is given.
///
/// If images behind the sensor's polarizers are interpolated, the noise is that of independent images with the same
/// noise of S1 and S2.
pub(super) fn noise_of(taken: &Photographed, maps: &mut StokesMaps, design: &Design) -> (Vec<FrameNoise>, NoiseSource) {
    let variances = taken.demosaic.variances();
    let of_residuals = variances.of_residuals(taken.views.len()) as f32;
    if taken.demosaic != Demosaic::None {
        maps.residual.iter_mut().for_each(|v| *v *= of_residuals);
    }
    let (mut noise, source) = noise_of_images(taken, maps, design);
    if source != NoiseSource::Estimated {
        noise.iter_mut().for_each(|n| *n = n.scaled(variances.stokes));
    }
    (noise, source)
}

/// Noise of the sensor's pixels as given or assumed, or estimated from the residuals.
fn noise_of_images(taken: &Photographed, maps: &mut StokesMaps, design: &Design) -> (Vec<FrameNoise>, NoiseSource) {
    let Photographed { frames, linearizer, brackets, views, sample, demosaic, shifts } = taken;
    let of_camera = || {
        let view = |v: &View| Merge::together(&noise_of_bracket(frames, linearizer, &brackets[v.bracket]));
        let mut noise: Vec<FrameNoise> = views.iter().map(view).collect();
        if let Some(shifts) = shifts {
            smoothed_noise(&mut noise, shifts, [maps.width, maps.height]);
        }
        noise
    };
    if frames.set.noise.is_some() {
        return (of_camera(), NoiseSource::Given);
    }
    if !maps.covariance.is_empty() {
        let Some(factor) = variance_factor(maps, design) else { return (of_camera(), NoiseSource::Assumed) };
        let noise = of_camera().into_iter().map(|n| n.scaled(factor)).collect();
        scale_variances(maps, factor);
        return (noise, NoiseSource::Estimated);
    }
    let step = linearizer.step() * frames.set.transfer.slope(1.0);
    let all = &frames.set.frames;
    let scale = all.iter().map(|f| f.scale()).sum::<f64>() / all.len() as f64;
    let quantisation = (step * scale).powi(2) / 12.0;
    let black = linearizer.lowest().map_or(f64::NEG_INFINITY, |v| v * scale);
    // Interpolated pixels share noise with their whole block, which would distort the scatter of repeats.
    let repeats = if *demosaic == Demosaic::None { pairs(frames, views, sample.views()) } else { vec![] };
    if let Some(noise) = calibrate(sample, &repeats, black, quantisation) {
        return (vec![noise; views.len()], NoiseSource::Repeats);
    }
    match estimate_noise(maps, design) {
        Some(mut noise) => {
            noise.floor = noise.floor.max(quantisation);
            (vec![noise; views.len()], NoiseSource::Estimated)
        }
        None => (of_camera(), NoiseSource::Assumed),
    }
}

/// Divides S1 and S2 by the contrast of the analyser, and returns the design of the corrected parameters: an analyser
/// of finite extinction transmits `(1 + K cos 2(ψ - α)) / 2` of light polarized along α.
pub(super) fn restore_contrast(maps: &mut StokesMaps, design: Design, contrast: f64) -> Design {
    if contrast == 1.0 {
        return design;
    }
    let gain = (1.0 / contrast) as f32;
    for plane in [&mut maps.s1, &mut maps.s2] {
        plane.iter_mut().for_each(|v| *v *= gain);
    }
    // Upper triangle of the covariance of (S0, S1, S2).
    let factors = [1.0, gain, gain, gain * gain, gain * gain, gain * gain];
    for covariance in &mut maps.covariance {
        covariance.iter_mut().zip(factors).for_each(|(v, f)| *v *= f);
    }
    design.with_contrast(contrast)
}

/// Corrects illumination and vignetting: a common factor per pixel (per super-pixel of a sensor), on which no
/// orientation depends. The covariance of the maps remains that of the uncorrected values.
pub(super) fn divide_by_flat(frames: &LoadedFrames, linearizer: &Linearizer, maps: &mut StokesMaps) -> Result<Flat> {
    let Some(flat) = &frames.set.flat else { return Ok(Flat::default()) };
    let light = linearizer.plane(&frames.file(flat))?;
    let (step, width) = (frames.info.width / maps.width, frames.info.width);
    let block = frames.set.filters().map_or(1, |f| f.block());
    let mean = light.iter().map(|&v| f64::from(v)).sum::<f64>() / light.len() as f64;
    if mean <= 0.0 {
        return Err(Error::file(&frames.file(flat), "is black", "give a photograph of an evenly lit white surface"));
    }
    let area = (block * block) as f32 * mean as f32;
    let mut factors = vec![0.0; maps.s0.len()];
    for (i, kept) in factors.iter_mut().enumerate() {
        let [x, y] = [i % maps.width, i / maps.width].map(|at| at * step / block * block);
        let sum: f32 = (0..block).flat_map(|j| light[(y + j) * width + x..][..block].iter()).sum();
        let factor = if sum > 0.0 { area / sum } else { f32::NAN };
        for plane in [&mut maps.s0, &mut maps.s1, &mut maps.s2] {
            plane[i] *= factor;
        }
        *kept = factor;
    }
    // The noise of the pixels of a block averages out.
    Ok(Flat { factors, sigma: frames.set.flat_sigma() as f32 / block as f32 })
}
