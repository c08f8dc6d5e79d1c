//! Studies of periods from photographs behind an analyser: from the degree of polarization, and from the brightness as
//! in the 2018 paper.

use nacre_base::Result;
use nacre_optics::rcwa::{ALUMINIUM, Grating, Light, Polarization, solve};
use nacre_polarimetry::synthetic::{Synthetic, even_angles, normal, uniform};
use nacre_polarimetry::{Design, Fit, NoiseModel, PeriodScale, orient, relative_period};
use nacre_studies::{Axis, Effort, Outcome, Scene, Setting, Study};
use num_complex::Complex;
use std::f64::consts::PI;
use std::time::Instant;

/// Wavelength in nm, and depth in µm of the aluminium foil in air.
const NM: f64 = 560.0;
const FOIL: Grating = Grating { period_um: 1.0, depth_um: 0.1, above: 1.0, below: ALUMINIUM };

/// Complex refractive index of a silver foil near 560 nm.
const SILVER: Complex<f64> = Complex::new(0.12, 3.45);

/// Longest period in view, in µm, assigned to the brightest pixels.
const LONGEST_UM: f64 = 3.0;

const PERIODS: [f64; 10] = [0.7, 0.8, 0.9, 1.1, 1.3, 1.5, 1.65, 1.8, 2.2, 2.7];
const UNEVEN: [f64; 6] = [0.0, 0.02, 0.05, 0.1, 0.2, 0.4];

/// Error of R in the inverted lookup table, as in the reconstruction.
const TABLE_ERROR: f64 = 1e-3;

/// Methods of period estimation: name and assumptions.
const WAYS: [(&str, Way); 5] = [
    ("polarization, all periods", Way::Polarization(FOIL, [0.6, LONGEST_UM])),
    ("polarization, within 15 %", Way::Near(FOIL)),
    ("depth 10 % too small", Way::Near(Grating { depth_um: 0.09, ..FOIL })),
    ("silver assumed", Way::Near(Grating { below: SILVER, ..FOIL })),
    ("brightness (paper)", Way::Brightness),
];

#[derive(Clone, Copy)]
enum Way {
    /// Assumed surface, and range of periods in µm.
    Polarization(Grating, [f64; 2]),
    /// As above, with the period known to 15 %.
    Near(Grating),
    /// Section 5.4 of the 2018 paper.
    Brightness,
}

/// Studies against the period, and against the uniformity of light and reflectance.
pub(super) fn studies(effort: Effort) -> Vec<Study> {
    let periods: Vec<[f64; 2]> = PERIODS.map(|p| [p, 0.0]).to_vec();
    let uneven: Vec<[f64; 2]> = UNEVEN.map(|u| [1.3, u]).to_vec();
    vec![
        study(
            effort,
            "period",
            "Periods from polarization and from brightness",
            Axis::linear("period", "µm"),
            periods,
            4,
        ),
        study(
            effort,
            "period-light",
            "Periods in uneven light",
            Axis::linear("unevenness of light or reflectance, ±", ""),
            uneven,
            2,
        ),
    ]
}

fn study(
    effort: Effort,
    name: &'static str,
    title: &str,
    stress: Axis,
    mut scenes: Vec<[f64; 2]>,
    mut reference: usize,
) -> Study {
    let pixels = effort.pick(4096, 1024);
    if effort == Effort::Quick {
        scenes = scenes.into_iter().step_by(2).collect();
        reference /= 2;
    }
    let value = |scene: &[f64; 2]| Scene::new(if name == "period" { scene[0] } else { scene[1] });
    Study {
        name,
        group: "polarimetry",
        title: title.into(),
        question: format!(
            "Aluminium foil, a sinusoid 0.1 µm deep in air at {NM} nm (rigorous coupled waves), all orientations, {pixels} pixels, 12 angles, 40,000 electrons. \
             Half of the pixels have the period that is asked for, half {LONGEST_UM} µm. The degree of polarization is inverted for an assumed depth and \
             metal, where periods are known to lie between 0.6 and {LONGEST_UM} µm, or within 15 %. The brightness (2018 paper, section 5.4) takes the \
             brightest pixel for {LONGEST_UM} µm. No map of periods is made unless one asks for it. The time includes solving Maxwell's equations for the range of periods. \
             Masked: no period or several answer. Wrong and confident: more than five of its own σ, which holds noise but no wrong assumption; the brightness has no σ."
        ),
        knob: Axis::names("method"),
        stress,
        error: Axis::log("relative error of the period (RMS)", ""),
        time: Axis::log("time of the map", "s"),
        predicted: "σ of the map",
        settings: WAYS.iter().enumerate().map(|(k, (name, _))| Setting::new(name, *name, k as f64)).collect(),
        scenes: scenes.iter().map(value).collect(),
        reference,
        run: Box::new(move |setting, scene, seed| run(pixels, WAYS[setting].1, scenes[scene], seed)),
    }
}

/// Ratio of the polarizations, and power of the polarization along the grating vector, of a foil's specular reflection.
fn specular(foil: &Grating) -> Result<(Complex<f64>, f64)> {
    let light = Light { wavelength_nm: NM, angle: 0.0 };
    let s = solve(foil, &light, Polarization::Te, 1e-5)?.reflected(0).amplitude;
    let p = solve(foil, &light, Polarization::Tm, 1e-5)?.reflected(0).amplitude;
    Ok((s / p, p.norm_sqr()))
}

fn run(pixels: usize, way: Way, [period_um, uneven]: [f64; 2], seed: u64) -> Result<Outcome> {
    let foils = [specular(&Grating { period_um, ..FOIL })?, specular(&Grating { period_um: LONGEST_UM, ..FOIL })?];
    let scenes = foils.map(|(ratio, _)| Synthetic { ratio, ..Synthetic::default() });
    let angles = even_angles(12);
    let (design, mut fit) = (Design::new(&angles)?, Fit::new(pixels, 1));
    let noise = NoiseModel { full_scale_e: 40_000.0, read_noise_e: 8.0 }.frame(1.0, 1.0, 0.0);
    let brightest = foils.iter().map(|(r, p)| p * (1.0 + r.norm_sqr())).fold(0.0, f64::max) * (1.0 + uneven);
    let lights: Vec<_> = (0..pixels)
        .map(|i| {
            let foil = i % 2;
            let gain = foils[foil].1 * (1.0 + uneven * (2.0 * uniform(seed ^ 5, i as u64) - 1.0));
            scenes[foil].stokes(PI * uniform(seed ^ 4, i as u64)) * (0.8 * gain / brightest)
        })
        .collect();
    for (k, psi) in angles.iter().enumerate() {
        fit.add(*psi, |_, values, _| {
            for (i, (value, light)) in values.iter_mut().zip(&lights).enumerate() {
                let clean = light.through_analyser(*psi);
                let sigma = (noise.shot * clean + noise.floor).sqrt();
                *value = (clean + sigma * normal(seed ^ (k as u64 + 9) << 40, i as u64)) as f32;
            }
        });
    }
    let mut maps = fit.solve(&design);
    let orientation = orient(&mut maps, &design, &vec![noise; angles.len()], 0.0);
    let begun = Instant::now();
    let found = match way {
        Way::Polarization(foil, range) => PeriodScale::new(&foil, range, NM, TABLE_ERROR)?.invert(&maps, &orientation),
        Way::Near(foil) => {
            let range = [0.85 * period_um, 1.15 * period_um];
            PeriodScale::new(&foil, range, NM, TABLE_ERROR)?.invert(&maps, &orientation)
        }
        Way::Brightness => relative_period(&maps, &orientation, [0.0, LONGEST_UM])?,
    };
    let seconds = begun.elapsed().as_secs_f64();
    let asked = || (0..pixels).step_by(2).map(|i| [found.period_um[i], found.sigma_um[i]].map(f64::from));
    let known: Vec<[f64; 2]> = asked().filter(|p| p[0].is_finite()).collect();
    let (all, n) = (asked().count() as f64, known.len() as f64);
    let root = |part: fn(&[f64; 2], f64) -> f64| {
        (n > 0.0).then(|| (known.iter().map(|p| part(p, period_um).powi(2)).sum::<f64>() / n).sqrt() / period_um)
    };
    let wrong = known.iter().filter(|p| (p[0] - period_um).abs() > 5.0 * p[1]).count() as f64 / all;
    Ok(Outcome {
        error: root(|p, truth| p[0] - truth),
        seconds,
        masked: 1.0 - n / all,
        wrong,
        predicted: root(|p, _| p[1]).filter(|p| p.is_finite()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The correct depth gives the period to within its σ; a wrong depth and the brightness do not.
    #[test]
    fn the_depth_must_be_known() {
        let of = |k: usize| run(1024, WAYS[k].1, [1.3, 0.0], 3).unwrap();
        let [right, shallow, bright] = [1, 2, 4].map(of);
        let ratio = right.error.unwrap() / right.predicted.unwrap();
        assert!((0.7..1.3).contains(&ratio) && right.wrong == 0.0, "{right:?}");
        assert!(shallow.masked > 0.5 || shallow.error.unwrap() > 5.0 * right.error.unwrap(), "{shallow:?}");
        assert!(bright.error.unwrap() > 0.5, "{bright:?}");
    }
}
