//! Limits of the BRDF methods for height fields.

use super::{coherence, sums};
use nacre_base::progress::Silent;
use nacre_base::{Error, Result};
use nacre_brdf::gems;
use nacre_brdf::height::{HeightField, Profile, Quality, Shape, Synthetic};
use nacre_brdf::{
    Direction, Map, Method, OrderMethod, Pair, Section, Settings, Views, Window, check, map, most_orders, slice,
};
use nacre_optics::color::linear_srgb;
use nacre_optics::rcwa;
use nacre_studies::{Axis, Effort, Outcome, Scene, Setting, Study};
use num_complex::Complex64;
use std::f64::consts::TAU;
use std::time::Instant;

/// Description of one study: question, stress axis and settings.
pub(super) struct Stress {
    pub(super) name: &'static str,
    pub(super) title: &'static str,
    pub(super) question: &'static str,
    pub(super) axis: Axis,
    pub(super) values: &'static [f64],
    pub(super) reference: usize,
    pub(super) error: &'static str,
    pub(super) predicted: &'static str,
    /// Names of the settings; the first is the default of the program.
    pub(super) settings: &'static [&'static str],
    pub(super) run: fn(setting: usize, value: f64, seed: u64) -> Result<Outcome>,
}

/// All stress studies of height-field BRDFs.
pub(super) fn studies(_: Effort) -> Vec<Study> {
    [
        rigorous(),
        incidence(),
        periods(),
        mirror(),
        orders(),
        period_only(),
        sums::steps(),
        sums::neighbours(),
        coherence::study(),
    ]
    .map(Stress::study)
    .into()
}

impl Stress {
    fn study(self) -> Study {
        let setting = |(k, name): (usize, &&str)| {
            let setting = Setting::new(name, *name, k as f64);
            if k == 0 { setting.as_default() } else { setting }
        };
        let values = self.values;
        Study {
            name: self.name,
            group: "surface",
            title: self.title.into(),
            question: self.question.into(),
            knob: Axis::names("method"),
            stress: self.axis,
            error: Axis::log(self.error, ""),
            time: Axis::log("time", "s"),
            predicted: self.predicted,
            settings: self.settings.iter().enumerate().map(setting).collect(),
            scenes: values.iter().copied().map(Scene::new).collect(),
            reference: self.reference,
            run: Box::new(move |setting, scene, seed| (self.run)(setting, values[scene], seed)),
        }
    }
}

/// An outcome without predicted error. The logarithmic axis needs a positive error even for identical numbers.
pub(super) fn plain(error: f64, begun: Instant) -> Outcome {
    let wrong = f64::from(u8::from(error.is_nan()));
    Outcome {
        error: Some(error.max(1e-16)),
        seconds: begun.elapsed().as_secs_f64(),
        masked: 0.0,
        wrong,
        predicted: None,
    }
}

/// An outcome with a predicted error.
pub(super) fn outcome_with_prediction(error: f64, predicted: f64, begun: Instant) -> Outcome {
    let wrong = f64::from(u8::from(error.is_nan() || error > 5.0 * predicted));
    Outcome { wrong, predicted: Some(predicted), ..plain(error, begun) }
}

/// Outcome of a scene that the method refuses.
pub(super) fn refused(begun: Instant) -> Outcome {
    Outcome { error: None, seconds: begun.elapsed().as_secs_f64(), masked: 1.0, wrong: 0.0, predicted: None }
}

fn rigorous() -> Stress {
    Stress {
        name: "surface-rcwa",
        title: "Where scalar theory fails",
        question: "A sinusoid of aluminium, 0.1 µm deep, in light of 560 nm at normal incidence: the light of the first order, both polarizations \
                   together, against rigorous coupled waves. Efficiencies take the phase of the mirror direction; Stam's flux has the phase \
                   and the gain of the order's own; the paper's lobes are those of its second-order Taylor series. All times the reflectance \
                   of a mirror, which is known.",
        axis: Axis::log("period", "µm"),
        values: &[0.6, 0.8, 1.0, 1.5, 2.0, 3.0, 5.0],
        reference: 3,
        error: "relative error of the first order",
        predicted: "",
        settings: &["Stam's flux", "efficiency", "second-order lobes (2018)"],
        run: |setting, period_um, _| {
            let (nm, depth_um) = (560.0, 0.1);
            let below = Complex64::new(0.96, 6.69);
            let grating = rcwa::Grating { period_um, depth_um, above: 1.0, below };
            let light = rcwa::Light { wavelength_nm: nm, angle: 0.0 };
            let mut truth = 0.0;
            for polarization in [rcwa::Polarization::Te, rcwa::Polarization::Tm] {
                truth += 0.5 * rcwa::solve(&grating, &light, polarization, 1e-4)?.reflected(1).efficiency;
            }
            let begun = Instant::now();
            let reflectance = ((below - 1.0) / (below + 1.0)).norm_sqr();
            let section = Section::Formula { profile: Profile::Sinusoid, depth_um };
            let sine = nm / 1e3 / period_um;
            let out =
                Direction::of(sine, 0.0).ok_or_else(|| Error::input("period", "has no first order", "raise it"))?;
            let pair = Pair::new(Direction::new(0.0, 0.0), out);
            let number = TAU * 1e3 / nm;
            let (q, gain, method) = match setting {
                // Flux of a lobe: ∫ f cos θ dω = ∫ f dx dy, where f is a density over frequencies.
                0 => (number * pair.w, pair.gain, OrderMethod::Exact),
                1 => (2.0 * number, 1.0, OrderMethod::Exact),
                _ => (2.0 * number, 1.0, OrderMethod::Taylor2),
            };
            let most = most_orders(q, depth_um);
            let found = reflectance * gain * section.efficiencies(q, most, method)?[most + 1];
            Ok(plain((found / truth - 1.0).abs(), begun))
        },
    }
}

pub(super) const METHODS: [Method; 7] =
    [Method::Auto, Method::Taylor, Method::Chebyshev, Method::Fft, Method::Nmm, Method::Pq, Method::PqLinear];
pub(super) const NAMES: [&str; 7] =
    ["auto", "Taylor (FLSS)", "Chebyshev", "transforms of exp", "nmm", "pq", "pq, linear"];

fn blazed(pixels: usize, periods: f64) -> Result<HeightField> {
    let pixel_um = 2.5 * periods / pixels as f64;
    let shape = Shape::Grating(Profile::Blazed);
    Synthetic { shape, pixels, pixel_um, period_um: 2.5, depth_um: 0.3, angle: 0.0 }.field()
}

/// The period by the grating equation, relative to 2.5 µm, of a method.
fn equation(setting: usize, field: &HeightField, theta: f64) -> Result<Outcome> {
    let quality = Quality::of(field, 65.0);
    let all: Vec<f64> = (400..=700).step_by(20).map(f64::from).collect();
    // pq misses its target error and reports it.
    let settings =
        Settings { light_deg: [theta, 0.0], method: METHODS[setting], max_error: 0.5, ..Settings::default() };
    let begun = Instant::now();
    match check(field, &quality, &settings, &all, [Some(2.5), Some(0.0)], &Silent) {
        // A patch with a warning is no reliable result, unless it was replaced by one period of its grating.
        Ok(found) => {
            let relied_on = quality.is_periodic() || found.cut_periods.is_some();
            let masked = if relied_on { 0.0 } else { 1.0 };
            Ok(Outcome { masked, ..plain((found.mean_nm / 2500.0 - 1.0).abs(), begun) })
        }
        Err(_) => Ok(refused(begun)),
    }
}

fn incidence() -> Stress {
    Stress {
        name: "surface-incidence",
        title: "Grazing light",
        question: "Mean period by the peaks of the first order of a blazed grating (2.5 µm, 0.3 µm deep, three periods on the patch), 400 to 700 nm, against the \
                   grating equation. Masked where a method refuses.",
        axis: Axis::linear("angle of incidence", "°"),
        values: &[0.0, 30.0, 60.0, 75.0, 85.0, 89.0],
        reference: 3,
        error: "relative error of the period",
        predicted: "",
        settings: &NAMES,
        run: |setting, theta, _| equation(setting, &blazed(120, 3.0)?, theta),
    }
}

fn periods() -> Stress {
    Stress {
        name: "surface-patch",
        title: "Patches of few periods, and of no whole number of them",
        question: "Mean period by the peaks of the first order of a blazed grating (2.5 µm, 0.3 µm deep) under light at 75°, against the grating equation, where \
                   the patch holds this many periods; where they are no whole number, one period of the grating stands in for the patch. Masked \
                   where a method refuses, or the report warns of seams.",
        axis: Axis::linear("periods on the patch", ""),
        values: &[0.5, 0.8, 1.0, 1.5, 2.0, 2.5, 3.0, 4.5, 8.0, 12.3],
        reference: 6,
        error: "relative error of the period",
        predicted: "",
        settings: &NAMES,
        run: |setting, count, _| equation(setting, &blazed((40.0 * count) as usize, count)?, 75.0),
    }
}

/// A sinusoid, its spectra over these angles at normal incidence, and the largest relative error against direct sums.
/// Only directions with at least 1/1000 of the mirror direction's value count.
fn near(depth_um: f64, theta: &[f64], order: Option<usize>, method: Method) -> Result<Outcome> {
    let shape = Shape::Grating(Profile::Sinusoid);
    let field = Synthetic { shape, pixels: 96, pixel_um: 0.08, period_um: 1.28, depth_um, angle: 0.0 }.field()?;
    let quality = Quality::of(&field, 65.0);
    let nm = [420.0, 550.0, 680.0];
    let of = |method, order, max_error| {
        let settings = Settings { method, order, max_error, ..Settings::default() };
        slice(&field, &quality, &settings, [&nm, theta], Some(0.0), &Silent)
    };
    let truth = of(Method::Reference, None, 0.01)?;
    let begun = Instant::now();
    let wanted = if order.is_some() || matches!(method, Method::Pq | Method::PqLinear) { 0.5 } else { 0.01 };
    let Ok(found) = of(method, order, wanted) else { return Ok(refused(begun)) };
    let done = Instant::now();
    let peak = Window::new(65.0)?.peak();
    let mut error = 0.0_f64;
    for (k, nm) in nm.iter().enumerate() {
        for (j, degrees) in theta.iter().enumerate() {
            let pair = Pair::new(Direction::new(0.0, 0.0), Direction::new(degrees.to_radians(), 0.0));
            let floor = 1e-3 * peak * pair.gain * 1e6 / (nm * nm);
            let (a, b) = (found.values[k * theta.len() + j], truth.values[k * theta.len() + j]);
            error = error.max((a - b).abs() / b.max(floor));
        }
    }
    Ok(Outcome { seconds: (done - begun).as_secs_f64(), ..outcome_with_prediction(error, found.error_estimate, begun) })
}

fn mirror() -> Stress {
    Stress {
        name: "surface-mirror",
        title: "Near the mirror direction",
        question: "Spectra of a sinusoid (1.28 µm, 0.1 µm deep) at normal incidence in 25 directions up to this distance from the mirror's, where the \
                   grating equation has no wavelength: the largest error relative to direct sums. pq has an even window of its own shape, so its lobes \
                   differ. Wrong where off by more than five times what it says.",
        axis: Axis::log("sine of the largest angle", ""),
        values: &[1e-5, 1e-4, 1e-3, 0.01, 0.1, 0.5],
        reference: 2,
        error: "largest relative error",
        predicted: "the error that the slice says it has",
        settings: &NAMES,
        run: |setting, most, _| {
            let theta: Vec<f64> = (0..25).map(|k| (most * f64::from(k) / 24.0).asin().to_degrees()).collect();
            near(0.1, &theta, None, METHODS[setting])
        },
    }
}

fn orders() -> Stress {
    Stress {
        name: "surface-order",
        title: "The first order alone",
        question: "Highest power of the height that is kept: 1 as the 2017 paper draws measured heights with three tables, 2 and 5 as it compares. \
                   Spectra of a sinusoid (1.28 µm) at normal incidence up to 60°: the largest error relative to direct sums. Wrong where off by more than \
                   five times what it says.",
        axis: Axis::log("depth", "µm"),
        values: &[0.005, 0.01, 0.02, 0.05, 0.1, 0.2],
        reference: 3,
        error: "largest relative error",
        predicted: "the error that the slice says it has",
        settings: &["auto", "order 1", "order 2", "order 5"],
        run: |setting, depth_um, _| {
            let theta: Vec<f64> = (0..121).map(|k| f64::from(k) / 2.0).collect();
            let order = [None, Some(1), Some(2), Some(5)][setting];
            let method = if order.is_some() { Method::Taylor } else { Method::Auto };
            near(depth_um, &theta, order, method)
        },
    }
}

/// Linear RGB of directions that are not next to the mirror direction, scaled to a total root mean square of 1.
fn colors(map: &Map, of: impl Fn(usize, [f32; 3]) -> [f64; 3]) -> Vec<[f64; 3]> {
    let place =
        |k: usize| [(k % map.size) as f64, (k / map.size) as f64].map(|v| (2.0 * v + 1.0) / map.size as f64 - 1.0);
    let far = |k: &usize| map.xyz[*k][1].is_finite() && place(*k)[0].hypot(place(*k)[1]) > 0.1;
    let mut all: Vec<[f64; 3]> = (0..map.xyz.len()).filter(far).map(|k| of(k, map.xyz[k])).collect();
    let scale = (all.iter().flatten().map(|v| v * v).sum::<f64>() / all.len() as f64).sqrt().max(1e-300);
    all.iter_mut().flatten().for_each(|v| *v /= scale);
    all
}

fn period_only() -> Stress {
    Stress {
        name: "surface-gems",
        title: "Colours from a period alone",
        question: "A map (97 × 97 directions, normal incidence, coherence 12 µm) of a sinusoid of 1.6 µm: root mean square difference of linear red, green and blue \
                   from a map at 0.01 %, both scaled to the same light, without the mirror's surroundings. The shader of GPU Gems knows the period \
                   only: all orders alike, no width, no depth.",
        axis: Axis::log("depth", "µm"),
        values: &[0.02, 0.05, 0.1, 0.2, 0.4],
        reference: 2,
        error: "relative difference of colours",
        predicted: "",
        settings: &["auto", "period only (GPU Gems)"],
        run: |setting, depth_um, _| {
            let shape = Shape::Grating(Profile::Sinusoid);
            let field =
                Synthetic { shape, pixels: 80, pixel_um: 0.08, period_um: 1.6, depth_um, angle: 0.0 }.field()?;
            let quality = Quality::of(&field, 12.0);
            let of = |max_error| {
                let settings = Settings { coherence_um: 12.0, max_error, ..Settings::default() };
                map(&field, &quality, &settings, Views::all(97), &Silent)
            };
            let truth = of(1e-4)?;
            let begun = Instant::now();
            let found = if setting == 0 {
                let map = of(0.01)?;
                colors(&map, |_, xyz| linear_srgb(xyz).map(f64::from))
            } else {
                let sine = |k: usize| (2.0 * (k % truth.size) as f64 + 1.0) / truth.size as f64 - 1.0;
                colors(&truth, |k, _| gems::color(sine(k), 1.6))
            };
            let seconds = Instant::now();
            let truth = colors(&truth, |_, xyz| linear_srgb(xyz).map(f64::from));
            let square: f64 = found.iter().flatten().zip(truth.iter().flatten()).map(|(a, b)| (a - b).powi(2)).sum();
            let outcome = plain((square / truth.len() as f64).sqrt(), begun);
            Ok(Outcome { seconds: (seconds - begun).as_secs_f64(), ..outcome })
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(stress: &Stress, setting: usize, value: f64) -> f64 {
        (stress.run)(setting, value, 1).unwrap().error.unwrap()
    }

    #[test]
    fn studies_agree_with_the_docs() {
        // Scalar theory fails at fine periods but not at coarse ones; second-order lobes gain light everywhere.
        let all = rigorous();
        assert!(error(&all, 0, 5.0) < 1e-4 && error(&all, 0, 0.6) > 0.1);
        assert!(error(&all, 0, 2.0) < error(&all, 1, 2.0));
        assert!(error(&all, 2, 5.0) > 0.2);
        // Methods satisfy the grating equation or refuse the scene.
        for setting in [0, 2, 3] {
            assert!(error(&incidence(), setting, 85.0) < 1e-3, "{setting}");
        }
        // A patch that truncates its grating gives the grating's period as accurately as an untruncated one.
        for setting in 0..METHODS.len() {
            let cut = (periods().run)(setting, 4.5, 1).unwrap();
            assert!(cut.masked == 0.0 && cut.error.unwrap() < 2e-3, "{setting}: {cut:?}");
        }
        // Less than one period does not define a grating.
        let part = (periods().run)(0, 0.5, 1).unwrap();
        assert!(part.masked == 1.0, "{part:?}");
        // Close to the mirror direction, nmm has enough wavelengths.
        assert!(error(&mirror(), 4, 1e-4) < 0.01);
        // Orders against depth.
        for setting in 1..=3 {
            let found = (orders().run)(setting, 0.1, 1).unwrap();
            assert_eq!(found.wrong, 0.0, "{found:?}");
        }
        assert!(error(&orders(), 1, 0.1) > error(&orders(), 3, 0.1));
        // A period alone does not determine a BRDF.
        assert!(error(&period_only(), 1, 0.1) > 20.0 * error(&period_only(), 0, 0.1));
        // Steps and neighbours.
        assert!(
            error(&sums::steps(), 0, 32.0) < 0.01 && error(&sums::steps(), 4, 32.0) > error(&sums::steps(), 1, 32.0)
        );
        assert!(error(&sums::neighbours(), 0, 2.0) < 0.01 && error(&sums::neighbours(), 1, 2.0) > 0.1);
    }
}
