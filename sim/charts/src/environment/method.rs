//! Studies of environment lighting: a flat sample up to grazing angles, a grating, and samples near the poles of the
//! environment map.

use super::scene::{Last, Pattern, room};
use super::{Draft, outcome};
use nacre_base::Result;
use nacre_base::progress::Silent;
use nacre_render::environment::factor::{Factors, Settings};
use nacre_render::environment::{
    Environment, Frame, Grating, Lights, Reflection, Sampler, Steps, Table, clamped, lamps, normalized_error, planar,
    prefiltered, turned_back, turned_to, two_pass,
};
use nacre_sim::random::{key, uniform};
use nacre_studies::{Axis, Effort, Scene, Setting, Study};
use std::f64::consts::{FRAC_PI_2, TAU};
use std::time::Instant;

/// Pattern of the lookup table: a lattice of spots along the axes.
const PATTERN: Pattern = Pattern::Spots([0.0, 90.0]);
const RANK: usize = 21;
const LAMP_DEG: f64 = 2.0;

pub(super) fn studies(effort: Effort) -> Vec<Study> {
    vec![method(effort), wavelength(effort), poles(effort)]
}

/// A flat sample at the centre of the environment.
struct Sample {
    environment: Environment,
    table: Table,
    frame: Frame,
    views: Vec<[f64; 3]>,
    truth: Vec<[f32; 3]>,
}

/// Unit vectors within 2° of a polar angle (degrees) from the normal, at random azimuths.
fn around(frame: &Frame, polar_deg: f64, count: usize, seed: u64) -> Vec<[f64; 3]> {
    let view = |k: usize| {
        let azimuth = TAU * uniform(key(&[seed, k as u64, 1]));
        let (sin, cos) = (polar_deg + 4.0 * uniform(key(&[seed, k as u64, 2])) - 2.0).abs().to_radians().sin_cos();
        frame.world([sin * azimuth.cos(), sin * azimuth.sin(), cos])
    };
    (0..count).map(view).collect()
}

impl Sample {
    fn new(width: usize, size: usize, count: usize, polar_deg: f64, seed: u64) -> Result<Self> {
        let environment = room(width, LAMP_DEG, seed)?;
        let table = PATTERN.table(size, 0.02_f64.max(2.0 / size as f64))?;
        let frame = Frame::facing([1.0, 0.0, 0.0], FRAC_PI_2);
        let views = around(&frame, polar_deg, count, seed);
        let lights = Lights::new(&environment, 2);
        let truth = views.iter().map(|v| lights.by_table(&table, &frame, *v).map(|v| v as f32)).collect();
        Ok(Self { environment, table, frame, views, truth })
    }

    fn each(&self, value: impl Fn([f64; 3]) -> [f64; 3]) -> Vec<[f32; 3]> {
        self.views.iter().map(|v| value(*v).map(|v| v as f32)).collect()
    }

    /// The environment, prefiltered by the two-pass method.
    fn filtered(&self) -> Result<Environment> {
        let settings = Settings { rank: Some(RANK), directions: Some(PATTERN.directions()), ..Settings::default() };
        let mut picture = Factors::of(&self.table, &settings)?.reflected(&self.environment, &Silent)?;
        clamped(&mut picture);
        Environment::of(self.environment.width, self.environment.height, picture)
    }

    /// The exact correlation, interpolated over direction cosines.
    fn correlated(&self, size: usize) -> Result<Vec<[f32; 3]>> {
        let found: Reflection = planar(&self.table, &self.environment, &self.frame, size)?;
        let pixel = |view: [f64; 3]| {
            let [x, y, _] = self.frame.local(view);
            let [u, v] = [x, -y].map(|v| ((v + 1.0) * 0.5 * size as f64 - 0.5).clamp(0.0, size as f64 - 1.001));
            let (i, j) = (u as usize, v as usize);
            let (u, v) = (u - i as f64, v - j as f64);
            let at = |i: usize, j: usize, c: usize| f64::from(found.rgb[j * size + i][c]);
            std::array::from_fn(|c| {
                (1.0 - v) * ((1.0 - u) * at(i, j, c) + u * at(i + 1, j, c))
                    + v * ((1.0 - u) * at(i, j + 1, c) + u * at(i + 1, j + 1, c))
            })
        };
        Ok(self.each(pixel))
    }
}

/// Methods for a flat sample, in the order of the settings.
const METHODS: [(&str, &str); 9] = [
    ("filtered beforehand", "as the paper"),
    ("filtered beforehand", "with cos³ θ"),
    ("importance sampling", "16"),
    ("importance sampling", "64"),
    ("importance sampling", "256"),
    ("importance sampling", "1024"),
    ("lamps in the table", "5 × the mean"),
    ("correlation", "exact"),
    ("full integral", "1 per pixel"),
];

fn method(effort: Effort) -> Study {
    let [width, size] = effort.pick([1024, 256], [256, 96]);
    let count = effort.pick(200, 60);
    let cells = effort.pick(512, 192);
    let angles = [0.0, 10.0, 20.0, 35.0, 50.0, 65.0, 80.0];
    let last = Last::new();
    let setting = |(k, (method, label)): (usize, &(&str, &str))| {
        let setting = Setting::new(method, *label, k as f64);
        match k {
            // The method that `render` uses for a flat sample under an environment.
            7 => setting.as_default(),
            2 | 3 | 5 => setting.without_sweep(),
            _ => setting,
        }
    };
    Draft {
        name: "environment-method",
        title: "Methods for a flat sample",
        question: format!(
            "A flat sample with a square lattice of spots, seen from {count} directions at one angle. Filtered beforehand: two passes of rank \
             {RANK} over the environment, looked up in the mirror's direction, as the 2017 TOG paper (7.6 % there). Importance sampling: \
             pairs of directions drawn by the environment and by the table. Lamps: what is brighter than 5 times the mean is a point whose \
             spread is in the table, the rest is left to importance sampling with 16 pairs. Correlation: {cells}² directions at once. \
             An environment of {width} × {}, {size} entries a side; the truth takes four lights per pixel.",
            width / 2
        ),
        knob: Axis::names("method"),
        stress: Axis::linear("angle of view", "°"),
        time: "time of all views, with what is done beforehand",
        predicted: "the standard error of importance sampling",
        settings: METHODS.iter().enumerate().map(setting).collect(),
        scenes: angles.map(Scene::new).to_vec(),
        reference: 2,
        run: Box::new(move |setting, scene, seed| {
            let s = last.get(scene, seed, || Sample::new(width, size, count, angles[scene], seed))?;
            let begun = Instant::now();
            let mut predicted = None;
            let found = match setting {
                0 | 1 => {
                    let filtered = s.filtered()?;
                    s.each(|v| prefiltered(&filtered, &s.frame, v, setting == 1).map(f64::from))
                }
                2..=5 => {
                    let (sampler, pairs) = (Sampler::new(&s.table), 4_usize.pow(setting as u32));
                    let all: Vec<_> = s.views.iter().enumerate()
                        .map(|(k, v)| sampler.reflected(&s.environment, &s.frame, *v, pairs, key(&[seed, k as u64])))
                        .collect();
                    let values = s.truth.len() as f64 * 3.0;
                    let square: f64 = all.iter().flat_map(|e| e.error).map(|e| e * e).sum();
                    let mean: f64 = all.iter().flat_map(|e| e.radiance).sum::<f64>() / values;
                    predicted = Some((square / values).sqrt() / mean.max(f64::MIN_POSITIVE));
                    all.iter().map(|e| e.radiance.map(|v| v as f32)).collect()
                }
                6 => {
                    let (found, rest) = lamps(&s.environment, 5.0)?;
                    let sampler = Sampler::new(&s.table);
                    s.each(|v| {
                        let base = sampler.reflected(&rest, &s.frame, v, 16, seed).radiance;
                        let all = found.iter().map(|l| l.reflected(&s.table, &s.frame, v));
                        all.fold(base, |sum, l| std::array::from_fn(|c| sum[c] + l[c]))
                    })
                }
                7 => s.correlated(cells)?,
                _ => {
                    let lights = Lights::new(&s.environment, 1);
                    s.each(|v| lights.by_table(&s.table, &s.frame, v))
                }
            };
            Ok(outcome(normalized_error(&found, &s.truth), begun.elapsed().as_secs_f64(), predicted))
        }),
    }
    .study()
}

fn wavelength(effort: Effort) -> Study {
    let (width, count) = effort.pick((1024, 300), (256, 100));
    let periods = [10.0, 5.0, 2.5, 1.6, 1.0, 0.7];
    let steps = [
        Steps::Even(1.0),
        Steps::Even(5.0),
        Steps::Even(10.0),
        Steps::Even(20.0),
        Steps::Even(40.0),
        Steps::Adaptive(0.5),
        Steps::Adaptive(1.0),
        Steps::Adaptive(2.0),
        Steps::Adaptive(4.0),
    ];
    let setting = |s: &Steps| match s {
        Steps::Even(nm) => Setting::new("even", format!("{nm} nm"), *nm),
        Steps::Adaptive(1.0) => Setting::new("by displacement", "1 px", 1.0).as_default(),
        Steps::Adaptive(px) if *px == 4.0 => Setting::new("by displacement", "4 px", *px),
        Steps::Adaptive(px) => Setting::new("by displacement", format!("{px} px"), *px).without_sweep(),
    };
    let last = Last::new();
    Draft {
        name: "environment-wavelength",
        title: "Wavelengths of a grating under an environment",
        question: format!(
            "A sinusoid of 0.2 µm depth, seen from {count} directions up to 34° off its normal, as a sum over orders and wavelengths: 5 nm as \
             the papers, 20 nm, or steps in which an order moves by so many pixels of the environment ({width} × {}). Against steps of 0.25 \
             nm.",
            width / 2
        ),
        knob: Axis::log("step", "nm or px"),
        stress: Axis::log("period", "µm"),
        time: "time of all views",
        predicted: "",
        settings: steps.iter().map(setting).collect(),
        scenes: periods.map(Scene::new).to_vec(),
        reference: 3,
        run: Box::new(move |setting, scene, seed| {
            let grating = Grating { period_um: periods[scene], depth_um: 0.2, azimuth: 0.3 };
            let frame = Frame::facing([1.0, 0.0, 0.0], FRAC_PI_2);
            let run = |environment: &Environment, views: &[[f64; 3]], steps| -> Result<Vec<[f32; 3]>> {
                let one = |v: &[f64; 3]| -> Result<[f32; 3]> { Ok(grating.reflected(environment, &frame, *v, steps)?.0.map(|v| v as f32)) };
                views.iter().map(one).collect()
            };
            let s = last.get(scene, seed, || {
                let environment = room(width, 1.0, seed)?;
                let view = |k: usize| around(&frame, 34.0 * uniform(key(&[seed, k as u64])).sqrt(), 1, key(&[seed, k as u64]));
                let views: Vec<[f64; 3]> = (0..count).flat_map(view).collect();
                let truth = run(&environment, &views, Steps::Even(0.25))?;
                Ok((environment, views, truth))
            })?;
            let begun = Instant::now();
            let found = run(&s.0, &s.1, steps[setting])?;
            Ok(outcome(normalized_error(&found, &s.2), begun.elapsed().as_secs_f64(), None))
        }),
    }
    .study()
}

/// The frame rotated by the smallest angle to face a direction.
fn carried(frame: &Frame, to: [f64; 3]) -> Frame {
    let [x, y, z] = frame.local(to);
    let turn = |[a, b]: [f64; 2]| {
        // Rodrigues' formula for the rotation from (0, 0, 1) to (x, y, z).
        let along = (a * x + b * y) / (1.0 + z);
        frame.world([a - along * x, b - along * y, -(a * x + b * y)])
    };
    Frame { tangent: turn([1.0, 0.0]), bitangent: turn([0.0, 1.0]), normal: to }
}

fn poles(effort: Effort) -> Study {
    let [width, size] = effort.pick([1024, 256], [256, 96]);
    let count = effort.pick(200, 60);
    let latitudes = [0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 85.0];
    let names = ["two passes", "with the paper's rotations"];
    let last = Last::new();
    Draft {
        name: "environment-poles",
        title: "Lines that bend at the poles",
        question: format!(
            "A sample facing a direction at this latitude of the environment, upright, and surfaces around it (up to 20°) that face their own \
             directions with the sample turned by the shortest way. In the environment's own picture the pattern follows the meridians, \
             which run together at the poles; turned first, so that the sample lies in the middle, and back afterwards (2017 CVMP, \
             section 5.2), it does not, for two more interpolations. An environment of {width} × {}, rank {RANK}.",
            width / 2
        ),
        knob: Axis::names("passes"),
        stress: Axis::linear("latitude", "°"),
        time: "time of all passes",
        predicted: "",
        settings: vec![
            Setting::new(names[0], names[0], 0.0),
            Setting::new(names[1], names[1], 1.0).as_default(),
        ],
        scenes: latitudes.map(Scene::new).to_vec(),
        reference: 4,
        run: Box::new(move |setting, scene, seed| {
            let (sin, cos) = f64::to_radians(latitudes[scene]).sin_cos();
            let frame = Frame::facing([cos, 0.0, sin], FRAC_PI_2);
            let s = last.get(scene, seed, || {
                let environment = room(width, LAMP_DEG, seed)?;
                let table = PATTERN.table(size, 0.02_f64.max(2.0 / size as f64))?;
                let view = |k: usize| around(&frame, 20.0 * uniform(key(&[seed, k as u64])).sqrt(), 1, key(&[seed, k as u64]));
                let views: Vec<[f64; 3]> = (0..count).flat_map(view).collect();
                let lights = Lights::new(&environment, 2);
                let truth = |v: &[f64; 3]| lights.by_table(&table, &carried(&frame, *v), *v).map(|v| v as f32);
                let truth: Vec<[f32; 3]> = views.iter().map(truth).collect();
                let settings = Settings { rank: Some(RANK), directions: Some([0.0, FRAC_PI_2]), ..Settings::default() };
                let factors = Factors::of(&table, &settings)?;
                Ok((environment, factors, views, truth))
            })?;
            let (environment, factors, views, truth) = &*s;
            let begun = Instant::now();
            let reflect = |from: &Environment| -> Result<Environment> {
                let mut picture = two_pass(from, &factors.parts[0], &Silent)?;
                clamped(&mut picture);
                Environment::of(from.width, from.height, picture)
            };
            let picture = match setting {
                0 => reflect(environment)?,
                _ => turned_back(&reflect(&turned_to(environment, &frame)?)?, &frame)?,
            };
            let seconds = begun.elapsed().as_secs_f64();
            let found: Vec<[f32; 3]> = views.iter().map(|v| picture.radiance(*v)).collect();
            Ok(outcome(normalized_error(&found, truth), seconds, None))
        }),
    }
    .study()
}
