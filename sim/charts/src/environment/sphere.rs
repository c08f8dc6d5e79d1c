//! Studies of a sphere whose every point faces the viewer (2017 CVMP).

use super::scene::{EXTENT, Last, Pattern, room};
use super::{Draft, outcome};
use nacre_base::Result;
use nacre_base::progress::Silent;
use nacre_render::environment::factor::{Factors, Settings};
use nacre_render::environment::{Environment, Table, clamped, facing, normalized_error};
use nacre_studies::{Axis, Effort, Outcome, Scene, Setting, Study};
use std::time::Instant;

/// Names and patterns.
const PATTERNS: [(&str, Pattern); 6] = [
    ("lattice", Pattern::Spots([0.0, 90.0])),
    ("turned", Pattern::Spots([30.0, 120.0])),
    ("oblique", Pattern::Spots([10.0, 80.0])),
    ("two streaks", Pattern::Streaks(&[45.0, 135.0])),
    ("three streaks", Pattern::Streaks(&[10.0, 70.0, 130.0])),
    ("rings", Pattern::Rings),
];

/// Standard deviation of spots that 256 table entries resolve (half-vector units), and size of the lamps in degrees.
const SPOT: f64 = 0.02;
const LAMP_DEG: f64 = 1.5;

pub(super) fn studies(effort: Effort) -> Vec<Study> {
    vec![rank(effort), kernel(effort), resolution(effort)]
}

/// A scene and its full integral.
struct Truth {
    environment: Environment,
    table: Table,
    directions: [f64; 2],
    picture: Vec<[f32; 3]>,
}

impl Truth {
    fn new(width: usize, lamp_deg: f64, seed: u64, pattern: Pattern, size: usize, spot: f64) -> Result<Self> {
        let (environment, table) = (room(width, lamp_deg, seed)?, pattern.table(size, spot)?);
        let directions = pattern.directions();
        let picture = facing(&environment, &table, directions[1], &Silent)?;
        Ok(Self { environment, table, directions, picture })
    }

    fn factors(&self, table: &Table, rank: usize) -> Result<Factors> {
        Factors::of(table, &Settings { rank: Some(rank), directions: Some(self.directions), ..Settings::default() })
    }

    /// Error and time of the two passes.
    fn measured(&self, factors: &Factors, predicted: Option<f64>) -> Result<Outcome> {
        let begun = Instant::now();
        let mut found = factors.reflected(&self.environment, &Silent)?;
        let seconds = begun.elapsed().as_secs_f64();
        clamped(&mut found);
        Ok(outcome(normalized_error(&found, &self.picture), seconds, predicted))
    }
}

fn rank(effort: Effort) -> Study {
    let [width, size] = effort.pick([1024, 256], [256, 96]);
    let right = [1_usize, 2, 3, 5, 10, 21, 40];
    let printed = [1_usize, 3, 10, 21];
    let label = |r: usize| format!("rank {r}");
    let settings = right.iter().map(|r| {
        let setting = Setting::new("two passes", label(*r), *r as f64);
        match r {
            2 | 5 => setting.without_sweep(),
            _ => setting,
        }
    });
    let wrong = printed.iter().map(|r| {
        let setting = Setting::new("as printed", label(*r), *r as f64);
        if *r == 10 { setting } else { setting.without_sweep() }
    });
    let whole = Setting::new("sum along azimuths", "exact", 100.0);
    // The default of `factor`: as many terms as its default error requires.
    let chosen = Setting::new("terms by the error", "5 % of the table", 0.0).as_default();
    let last = Last::new();
    Draft {
        name: "environment-rank",
        title: "Terms of a table of low rank",
        question: format!(
            "How many terms do two passes need, for patterns of two directions at right angles, turned, and oblique, for crossed streaks, and \
             for patterns that do not separate? And what is left of the rank in the passes as the 2017 CVMP paper prints them? An \
             environment of {width} × {}, tables of {size} entries to half vectors of {EXTENT}, spots and streaks of σ = {SPOT}, lamps \
             of {LAMP_DEG}°.",
            width / 2
        ),
        knob: Axis::log("rank", ""),
        stress: Axis::names("pattern"),
        time: "time of the two passes",
        predicted: "the error under one light that is a point",
        settings: settings.chain(wrong).chain([whole, chosen]).collect(),
        scenes: PATTERNS.iter().enumerate().map(|(k, (name, _))| Scene::named(k, *name)).collect(),
        reference: 0,
        run: Box::new(move |setting, scene, seed| {
            let make = || Truth::new(width, LAMP_DEG, seed, PATTERNS[scene].1, size, SPOT.max(1.4 / size as f64));
            let truth = last.get(scene, seed, make)?;
            if setting == right.len() + printed.len() {
                let begun = Instant::now();
                let found = facing(&truth.environment, &truth.table, truth.directions[1], &Silent)?;
                let error = normalized_error(&found, &truth.picture).max(1e-7);
                return Ok(outcome(error, begun.elapsed().as_secs_f64(), None));
            }
            if setting > right.len() + printed.len() {
                let settings = Settings { directions: Some(truth.directions), ..Settings::default() };
                let factors = Factors::of(&truth.table, &settings)?;
                return truth.measured(&factors, Some(factors.picture_error_point()));
            }
            if let Some(rank) = right.get(setting) {
                let factors = truth.factors(&truth.table, *rank)?;
                return truth.measured(&factors, Some(factors.picture_error_point()));
            }
            let mut factors = truth.factors(&truth.table, printed[setting - right.len()])?;
            factors.parts = factors.parts.iter().map(|p| p.as_printed()).collect();
            truth.measured(&factors, None)
        }),
    }
    .study()
}

fn kernel(effort: Effort) -> Study {
    let (width, finest) = effort.pick((1024, 768), (256, 256));
    let sizes: [usize; 5] = effort.pick([64, 128, 256, 384, 512], [32, 64, 96, 128, 192]);
    let spots = effort.pick([0.006, 0.01, 0.02, 0.04, 0.08], [0.02, 0.03, 0.04, 0.06, 0.08]);
    let last = Last::new();
    let setting = |n: &usize| {
        let setting = Setting::new("two passes, rank 21", format!("{n}²"), *n as f64);
        if *n == sizes[2] { setting.as_default() } else { setting }
    };
    Draft {
        name: "environment-kernel",
        title: "Entries of the table",
        question: format!(
            "How many entries does a table to half vectors of {EXTENT} need? A square lattice of spots, against the same with {finest} entries \
             a side; an environment of {width} × {}.",
            width / 2
        ),
        knob: Axis::log("entries along a side", ""),
        stress: Axis::log("σ of the spots", ""),
        time: "time of the two passes",
        predicted: "",
        settings: sizes.iter().map(setting).collect(),
        scenes: spots.map(Scene::new).to_vec(),
        reference: 2,
        run: Box::new(move |setting, scene, seed| {
            let pattern = PATTERNS[0].1;
            let truth =
                last.get(scene, seed, || Truth::new(width, LAMP_DEG, seed, pattern, finest, spots[scene]))?;
            let factors = truth.factors(&pattern.table(sizes[setting], spots[scene])?, 21)?;
            truth.measured(&factors, None)
        }),
    }
    .study()
}

fn resolution(effort: Effort) -> Study {
    let [width, size] = effort.pick([2048, 256], [512, 96]);
    let lamps = [0.2, 0.5, 1.5, 5.0, 15.0];
    let names = ["full", "half", "a quarter", "an eighth", "a sixteenth"];
    let last = Last::new();
    let setting = |(k, name): (usize, &&str)| {
        let setting = Setting::new("two passes, rank 10", *name, (width >> k) as f64);
        if k == 1 { setting.as_default() } else { setting }
    };
    let spot = SPOT.max(1.4 / size as f64);
    Draft {
        name: "environment-resolution",
        title: "Resolution of the environment",
        question: format!(
            "May the environment be scaled down before it is reflected? From {width} × {} by halves, keeping the light of every region; the \
             result is compared at full size. Lamps from points to {} degrees; a square lattice, {size} entries a side.",
            width / 2,
            lamps[4]
        ),
        knob: Axis::log("columns", "px"),
        stress: Axis::log("standard deviation of the lamps", "°"),
        time: "time of scaling and two passes",
        predicted: "",
        settings: names.iter().enumerate().map(setting).collect(),
        scenes: lamps.map(Scene::new).to_vec(),
        reference: 2,
        run: Box::new(move |setting, scene, seed| {
            let truth = last.get(scene, seed, || Truth::new(width, lamps[scene], seed, PATTERNS[0].1, size, spot))?;
            let factors = truth.factors(&truth.table, 10)?;
            let begun = Instant::now();
            let mut small = truth.environment.clone();
            for _ in 0..setting {
                small = small.halved();
            }
            let mut found = factors.reflected(&small, &Silent)?;
            let seconds = begun.elapsed().as_secs_f64();
            clamped(&mut found);
            let small = Environment::of(small.width, small.height, found)?;
            let large = &truth.environment;
            let at = |i: usize| large.direction((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let found: Vec<[f32; 3]> = (0..large.rgb.len()).map(|i| small.radiance(at(i))).collect();
            Ok(outcome(normalized_error(&found, &truth.picture), seconds, None))
        }),
    }
    .study()
}
