//! Choice of the cheapest method that meets the requested error.

use super::bank::{Bank, Limits, MOST_BYTES, Relief, bytes, reach};
use super::engine::{Engine, Model, Request};
use super::expansion::{Expansion, Kind};
use super::geometry::Window;
use super::height::{HeightField, Quality};
use super::lattice::Lattice;
use super::measured::measured;
use super::pq::{Pq, interpolation_error, repeats};
use super::reference::Reference;
use super::settings::{FAINTEST, Method, Settings};
use super::transform::Real;
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use schemars::JsonSchema;
use serde::Serialize;

/// Fractions of the requested error for truncation and rounding of the expansion, for the window, for wavelengths, and
/// for omitted frequencies.
const EXPANSION: [f64; 2] = [0.125; 2];
pub(super) const WINDOW: f64 = 0.25;
pub(super) const STEP: f64 = 0.25;
const DARK: f64 = 0.1;

/// Cost model: times in ns, measured on one machine; only the ratios matter.
///
/// In order: a point of a transform per doubling of its size, a density, a frequency under the window, its terms in
/// groups of eight. Then a function of X, a test for a dark frequency, an exponential.
const POINT_NS: f64 = 0.9;
const DENSITY_NS: f64 = 60.0;
const NEAR_NS: f64 = 6.0;
const GROUP_NS: f64 = 1.6;
const COEFFICIENT_NS: f64 = 4.0;
const LOOK_NS: f64 = 1.0;
const EXPONENTIAL_NS: f64 = 15.0;

/// Reason for a method that the user chose.
const ASKED: &str = "asked for";

/// Chosen method, with the reason.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[schemars(rename = "BrdfChoice")]
pub struct Choice {
    /// Method of computation.
    pub method: Method,
    /// Precision in bits.
    pub bits: u32,
    /// Number of terms or transforms; absent for direct sums.
    pub terms: Option<usize>,
    /// Number of spatial frequencies with light.
    pub frequencies: Option<usize>,
    /// Predicted largest relative error from expansion, rounding and window, for lobes with at least 0.1 % of the
    /// light. For `pq`, it applies to lobes as strong as their neighbours.
    pub predicted_error: f64,
    /// Largest relative error, measured against direct sums at some points.
    pub measured_error: Option<f64>,
    /// Predicted CPU time in s.
    pub predicted_s: f64,
    /// Reason for the choice.
    pub why: String,
}

/// Method that is considered.
#[derive(Clone, Debug)]
struct Candidate {
    method: Method,
    expansion: Expansion,
    bits: u32,
    error: f64,
    seconds: f64,
}

fn epsilon(bits: u32) -> f64 {
    if bits == 32 { f64::from(f32::EPSILON) } else { f64::EPSILON }
}

/// Relative error of the faintest significant lobe, from an amplitude error.
pub(super) fn of_lobes(amplitude: f64) -> f64 {
    2.0 * amplitude / FAINTEST.sqrt()
}

struct Chooser<'a> {
    relief: &'a Relief<'a>,
    request: Request,
    radius: f64,
    wanted: f64,
    /// Fractions of the requested error for truncation and rounding of the expansion.
    parts: [f64; 2],
    /// Highest power requested by the user, regardless of its error.
    order: Option<usize>,
    workers: f64,
}

impl Chooser<'_> {
    /// Shortest expansion of a kind in this precision that meets the requested error and fits into memory; `None` if
    /// there is none.
    fn candidate(&self, method: Method, kind: Kind, bits: u32) -> Option<Candidate> {
        let [truncation, most_rounding] = self.parts.map(|part| part * self.wanted / 2.0 * FAINTEST.sqrt());
        let [low, high] = self.request.q.map(|q| q * self.relief.half_um);
        let expansion = match self.order {
            Some(order) => Expansion::with_terms(kind, low, high, order + 1),
            None => Expansion::new(kind, low, high, truncation, epsilon(bits))?,
        };
        let rounding = expansion.rounding(epsilon(bits));
        if rounding > most_rounding && self.order.is_none() {
            return None;
        }
        let reach = reach(self.relief, self.request.wide(self.radius));
        let need = if bits == 32 {
            bytes::<f32>(reach, self.relief.height, &expansion)
        } else {
            bytes::<f64>(reach, self.relief.height, &expansion)
        };
        if need > MOST_BYTES {
            return None;
        }
        let error = of_lobes(expansion.error() + rounding) + WINDOW * self.wanted;
        let seconds = self.seconds(&expansion, bits, 1.0, None);
        Some(Candidate { method, expansion, bits, error, seconds })
    }

    fn near(&self) -> f64 {
        let across = |um: f64, n: usize| if n > 1 { (2.0 * self.radius * um).max(1.0) } else { 1.0 };
        across(self.relief.size_um[0], self.relief.width) * across(self.relief.size_um[1], self.relief.height)
    }

    /// CPU time in s, if a fraction `lit` of the frequencies holds light, or only those of one grating.
    fn seconds(&self, expansion: &Expansion, bits: u32, lit: f64, grating: Option<Lattice>) -> f64 {
        let points = (self.relief.width * self.relief.height) as f64;
        let wide = if bits == 32 { 1.0 } else { 1.7 };
        let kind = if expansion.is_real() { 1.0 } else { 2.0 };
        let turning = if expansion.is_real() { 2.0 } else { EXPONENTIAL_NS };
        let once = expansion.terms as f64 * points * (turning + kind * wide * POINT_NS * points.log2().max(1.0));
        let groups = (expansion.terms as f64 / 8.0).ceil() * 2.0 * wide;
        let near = self.near();
        let each = DENSITY_NS
            + near * LOOK_NS
            + (lit * near).min(1.0) * COEFFICIENT_NS * expansion.terms as f64
            + lit * near * (NEAR_NS + GROUP_NS * groups);
        let part = grating.map_or(1.0, |g| (2.0 * self.radius / g.frequency[0].hypot(g.frequency[1])).min(1.0));
        1e-9 * (once + part * self.request.densities * each)
    }

    fn direct_seconds(&self) -> f64 {
        let points = (self.relief.width * self.relief.height) as f64;
        1e-9 * self.request.densities * points * (EXPONENTIAL_NS + 4.0 * self.near().sqrt())
    }
}

/// Checks that the pixel pitch can carry the requested orders.
///
/// # Errors
/// `Input` if it is too coarse.
pub(super) fn check_pitch(field: &HeightField, request: &Request) -> Result<()> {
    let limit = 0.5 / field.pixel_um;
    let along = [field.width, field.height];
    let worst = (0..2).filter(|k| along[*k] > 1).map(|k| request.frequency[k]).fold(0.0, f64::max);
    if worst <= limit {
        return Ok(());
    }
    let problem = format!(
        "has pixels of {} µm, which carry {limit:.2} cycles per µm; these directions and wavelengths need {worst:.2}, so pixels of at most \
         {:.4} µm",
        field.pixel_um,
        0.5 / worst
    );
    Err(Error::input(
        &field.name,
        problem,
        "give a finer one, or longer wavelengths, or directions nearer to the mirror's",
    ))
}

/// Prepares a patch for a request.
///
/// # Errors
/// `Input` if the pixel pitch is too coarse, or the requested method does not apply.
pub(super) fn prepare<'a>(
    field: &'a HeightField,
    quality: &Quality,
    request: Request,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<(Model<'a>, Choice)> {
    check_pitch(field, &request)?;
    let window = Window::new(settings.coherence_um)?;
    let relief = Relief::new(field);
    let radius = window.radius(WINDOW * FAINTEST * settings.max_error);
    let workers = rayon::current_num_threads() as f64;
    let chooser = Chooser {
        relief: &relief,
        request,
        radius,
        wanted: settings.max_error,
        parts: EXPANSION,
        order: settings.order,
        workers,
    };
    let model = |engine, lattice| Model { engine, window, radius, lattice };
    if settings.method == Method::Reference {
        let choice = Choice {
            method: Method::Reference,
            bits: 64,
            terms: None,
            frequencies: None,
            predicted_error: 1e-8,
            measured_error: None,
            predicted_s: chooser.direct_seconds(),
            why: ASKED.into(),
        };
        return Ok((model(Engine::Reference(Reference::new(field)), None), choice));
    }
    let single = matches!(settings.method, Method::Nmm).then(|| Lattice::find(&relief)).transpose()?;
    if matches!(settings.method, Method::Pq | Method::PqLinear) && !quality.is_periodic() {
        let problem = "repeats the patch, and this one does not go on at its edges";
        return Err(Error::input(
            "method pq",
            problem,
            "crop the patch to whole periods, or use auto, chebyshev or fft",
        ));
    }
    let (candidate, why) = chooser.choose(settings.method)?;
    progress.stage("transforming", candidate.expansion.terms as u64);
    let mut choice = Choice {
        method: candidate.method,
        bits: candidate.bits,
        terms: Some(candidate.expansion.terms),
        frequencies: None,
        predicted_error: candidate.error,
        measured_error: None,
        predicted_s: candidate.seconds,
        why,
    };
    // Negligible even if all omitted light were in one place.
    let dark = DARK * settings.max_error * FAINTEST;
    let wide = request.wide(radius);
    let step = || progress.step();
    let ready = match settings.method {
        Method::Pq | Method::PqLinear => {
            let linear = settings.method == Method::PqLinear;
            let repeats = repeats(relief.size_um, settings.coherence_um);
            choice.predicted_error += interpolation_error(repeats, linear);
            // Interpolation needs neighbouring frequencies too.
            let more = relief.size_um.map(|um| 6.0 / um);
            let frequency = [0, 1].map(|k| wide.frequency[k] + more[k]);
            let limits = Limits { frequency, length: wide.length + more[0].hypot(more[1]) };
            let bank = Bank::<f64>::new(&relief, candidate.expansion, limits, dark, step);
            choice.frequencies = Some(bank.bright());
            let pixels = [relief.width, relief.height];
            model(Engine::Pq(Box::new(Pq { bank, pixels, size_um: relief.size_um, repeats, linear })), None)
        }
        _ if candidate.bits == 32 => {
            let mut bank = Bank::<f32>::new(&relief, candidate.expansion.clone(), wide, dark, step);
            let lattice = settle(&mut bank, single, &relief, radius, &mut choice);
            choice.predicted_s = chooser.seconds(&candidate.expansion, 32, bank.share(), lattice);
            model(Engine::Single(bank), lattice)
        }
        _ => {
            let mut bank = Bank::<f64>::new(&relief, candidate.expansion.clone(), wide, dark, step);
            let lattice = settle(&mut bank, single, &relief, radius, &mut choice);
            choice.predicted_s = chooser.seconds(&candidate.expansion, 64, bank.share(), lattice);
            model(Engine::Double(bank), lattice)
        }
    };
    progress.check()?;
    choice.measured_error = measured(field, &ready, &request, settings.method);
    Ok((ready, choice))
}

/// Keeps only the frequencies of `nmm`, if requested. Otherwise detects whether all light is that of one grating, whose
/// other wavelengths are dark.
fn settle<T: Real>(
    bank: &mut Bank<T>,
    asked: Option<Lattice>,
    relief: &Relief,
    radius: f64,
    choice: &mut Choice,
) -> Option<Lattice> {
    let lattice = match asked {
        Some(lattice) => {
            bank.keep(|at| lattice.holds(at));
            Some(lattice)
        }
        None if choice.why != ASKED => Lattice::of(bank.lit(), relief.size_um, radius),
        None => None,
    };
    choice.frequencies = Some(bank.bright());
    if lattice.is_some() && choice.method != Method::Nmm {
        choice.why = format!(
            "all light is that of one grating, so that only its wavelengths are added up (nmm), by {}: {}",
            name(choice.method),
            choice.why
        );
        choice.method = Method::Nmm;
    }
    lattice
}

/// Expansion into real functions in single precision. `parts` are the fractions of the requested error for truncation
/// and rounding.
///
/// # Errors
/// `Input` for methods without such an expansion, and for depths that they cannot handle.
pub(super) fn expansion(relief: &Relief, request: Request, settings: &Settings, parts: [f64; 2]) -> Result<Expansion> {
    let method = match settings.method {
        Method::Auto => Method::Chebyshev,
        Method::Chebyshev | Method::Taylor => settings.method,
        other => {
            let problem = format!("{} has no real terms to be stored", name(other));
            return Err(Error::input("method", problem, "give auto, chebyshev or taylor"));
        }
    };
    let chooser = Chooser {
        relief,
        request,
        radius: 0.0,
        wanted: settings.max_error,
        parts,
        order: settings.order,
        workers: 1.0,
    };
    let kind = if method == Method::Taylor { Kind::Taylor } else { Kind::Chebyshev };
    let found = chooser.candidate(method, kind, 32);
    found.map(|c| c.expansion).ok_or_else(|| chooser.too_hard(method))
}

impl Chooser<'_> {
    /// Error for a method without a suitable expansion.
    fn too_hard(&self, method: Method) -> Error {
        let x = self.request.q[1] * self.relief.half_um;
        let (problem, remedy) = if method == Method::Taylor {
            (
                format!("cannot be exact to {} here: its terms reach e^{x:.0} before they cancel", self.wanted),
                "use auto, chebyshev or fft",
            )
        } else {
            (format!("needs too many terms, or more than {} GiB", MOST_BYTES >> 30), "crop the patch, or ask for less")
        };
        Error::input(format!("method {}", name(method)), problem, remedy)
    }

    /// Candidate of a method, or the cheapest of all, with the reason.
    fn choose(&self, method: Method) -> Result<(Candidate, String)> {
        let kinds: &[(Method, Kind)] = match method {
            Method::Taylor => &[(Method::Taylor, Kind::Taylor)],
            Method::Chebyshev => &[(Method::Chebyshev, Kind::Chebyshev)],
            Method::Fft => &[(Method::Fft, Kind::Nodes)],
            Method::Pq | Method::PqLinear => &[(method, Kind::Nodes)],
            Method::Nmm => &[(Method::Nmm, Kind::Chebyshev), (Method::Nmm, Kind::Nodes)],
            Method::Auto | Method::Reference => {
                &[(Method::Chebyshev, Kind::Chebyshev), (Method::Fft, Kind::Nodes), (Method::Taylor, Kind::Taylor)]
            }
        };
        let precisions: &[u32] = if matches!(method, Method::Pq | Method::PqLinear) { &[64] } else { &[32, 64] };
        let mut all: Vec<Candidate> = kinds
            .iter()
            .flat_map(|(method, kind)| precisions.iter().filter_map(|bits| self.candidate(*method, *kind, *bits)))
            .collect();
        all.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
        let Some(best) = all.first().cloned() else { return Err(self.too_hard(method)) };
        let why = if method == Method::Auto {
            let others: Vec<String> = all
                .iter()
                .filter(|c| c.method != best.method)
                .map(|c| format!("{} in {} bits {:.2} s", name(c.method), c.bits, c.seconds / self.workers))
                .collect();
            let others = if others.is_empty() { "no other method".into() } else { others.join(", ") };
            format!(
                "the cheapest that is exact to {} %: {} terms in {} bits, {:.2} s; {others}",
                100.0 * self.wanted,
                best.expansion.terms,
                best.bits,
                best.seconds / self.workers
            )
        } else {
            ASKED.into()
        };
        Ok((best, why))
    }
}

/// Name of a method in options.
pub fn name(method: Method) -> &'static str {
    match method {
        Method::Auto => "auto",
        Method::Reference => "reference",
        Method::Taylor => "taylor",
        Method::Chebyshev => "chebyshev",
        Method::Fft => "fft",
        Method::Nmm => "nmm",
        Method::Pq => "pq",
        Method::PqLinear => "pq-linear",
    }
}
