//! Transforms of a height field's expansion terms as files, for real-time rendering of all directions and wavelengths
//! (2014 thesis, section 4.2, with polynomials that do not cancel).

use super::bank::{Bank, Relief, planes, reach};
use super::choose::{self, of_lobes};
use super::engine::{Engine, Model, Request};
use super::expansion::{Expansion, Kind, MOST_TERMS};
use super::geometry::Window;
use super::height::HeightField;
use super::measured::measured;
use super::settings::{Method, Settings};
use super::spectral::RANGE_NM;
use super::transform::Plane;
use nacre_base::progress::Progress;
use nacre_base::text::{from_json, read_text};
use nacre_base::{Error, Result};
use nacre_image::{Attribute, OutputFolder, Precision, read_exr, write_exr_as};
use num_complex::Complex32;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use std::path::Path;

/// Name of the description in a folder of terms.
pub const TERMS_FILE: &str = "terms.json";

/// Largest description in bytes.
const MAX_BYTES: u64 = 1 << 20;

/// Largest number of frequencies to each side; larger sets take gigabytes.
const MOST_REACH: usize = 4096;

/// Fraction of the coherence window outside of the margin beyond the extent.
const OUTSIDE: f64 = 1e-6;

/// Largest rounding error of half precision, for numbers near 1 and near 0.
const HALF: [f64; 2] = [0.000_488_281_25, 3e-8];

/// Description of a set of terms.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TermsAbout {
    /// `taylor` or `chebyshev`.
    pub kind: String,
    /// Number of terms and files.
    pub terms: usize,
    /// Precision of the files.
    pub precision: Precision,
    /// Width and height of the patch in µm: frequency `ix/width` to the right and `iy/height` up.
    pub size_um: [f64; 2],
    /// Half the range of heights in µm.
    pub half_um: f64,
    /// Number of frequencies to each side of the centre: planes have `2 · reach + 1` columns and rows, the highest on
    /// top.
    pub reach: [usize; 2],
    /// Largest `X = 2π/λ (cos θi + cos θr) · half_um`.
    pub x_most: f64,
    /// Largest component of `ωi + ωr` in the plane within the frequencies at 380 nm.
    pub extent: f64,
    /// Predicted largest relative error from truncation and rounding, for lobes with at least 0.1 % of the light.
    pub predicted_error: f64,
    /// Formula for the use of the terms.
    pub formula: String,
}

/// Set of terms that was read from a folder.
pub struct Terms {
    about: TermsAbout,
    bank: Bank<f32>,
}

/// Options of a set of terms.
#[derive(Clone, Copy, Debug)]
pub struct TermsRequest {
    /// Largest component of `ωi + ωr` in the plane, 0.01 to 2; 2 is for all directions of light and viewer.
    pub extent: f64,
    /// Precision of the files; by default the lowest that meets the error.
    pub precision: Option<Precision>,
}

fn formula(kind: Kind) -> String {
    let function = match kind {
        Kind::Taylor => "(X/x_most)^n",
        _ => "J_0(X) for n = 0, else 2 J_n(X) (Bessel functions)",
    };
    format!(
        "amplitude(ix, iy) = sum over n of a_n(X) * (re + i im) of term n, with a_n(X) = {function} and X = 2 pi / wavelength * (cos theta_i + \
         cos theta_r) * half_um; the power density at a frequency (fx, fy) is the sum over (ix, iy) of |amplitude|^2 * g(fx - ix/width, fy - \
         iy/height), g the coherence window: a Gaussian of integral 1 and standard deviation 1/(2 sqrt(2) pi * coherence/4). BRDF = \
         reflectance * gain / wavelength^2 * density at -(omega_i + omega_r)/wavelength, gain = (1 + omega_i . omega_r)^2 / (cos theta_i cos \
         theta_r (cos theta_i + cos theta_r)^2)"
    )
}

/// File name of a term.
fn file_of(term: usize) -> String {
    format!("term_{term:03}.exr")
}

/// Request for all directions within an extent.
fn request(extent: f64) -> Request {
    Request {
        q: [0.0, 2.0 * TAU * 1e3 / RANGE_NM[0]],
        frequency: [extent * 1e3 / RANGE_NM[0]; 2],
        length: (2_f64.sqrt() * extent).min(2.0) * 1e3 / RANGE_NM[0],
        // Only the transforms are needed.
        densities: 0.0,
    }
}

/// Set of terms of a height field, before it is written.
pub struct TermSet {
    /// Description of the set.
    pub about: TermsAbout,
    planes: Vec<Plane<f32>>,
}

impl TermSet {
    /// Computes the terms of a height field.
    ///
    /// # Errors
    /// `Input` for invalid settings, pixels that are too coarse, and depths that the expansion cannot handle.
    pub fn new(
        field: &HeightField,
        settings: &Settings,
        wanted: TermsRequest,
        progress: &dyn Progress,
    ) -> Result<Self> {
        settings.check()?;
        if !(0.01..=2.0).contains(&wanted.extent) {
            return Err(Error::input("extent", format!("is {}", wanted.extent), "give 0.01 to 2"));
        }
        let request = request(wanted.extent);
        choose::check_pitch(field, &request)?;
        let relief = Relief::new(field);
        // If half precision is possible, most of the error is allotted to its rounding. Otherwise, the expansion gets
        // the whole error.
        let halved = wanted.precision == Some(Precision::Half) || of_lobes(HALF[0]) < 0.5 * settings.max_error;
        let parts = if halved { [0.125; 2] } else { [0.75, 0.25] };
        let expansion = choose::expansion(&relief, request, settings, parts)?;
        let wide = request.wide(Window::new(settings.coherence_um)?.radius(OUTSIDE));
        if let Some(side) = reach(&relief, wide).into_iter().find(|r| *r > MOST_REACH) {
            let problem = format!("has {} frequencies along one side", 2 * side + 1);
            return Err(Error::input(&field.name, problem, "crop it, or give a smaller --extent"));
        }
        progress.stage("transforming", expansion.terms as u64);
        let (reach, planes) = planes::<f32>(&relief, &expansion, wide, || progress.step());
        progress.check()?;
        let exact = of_lobes(expansion.error() + expansion.rounding(f64::from(f32::EPSILON)));
        let halves = Halves::new(&expansion, &planes);
        // The mean is nearly always the largest amplitude. If its error is too large, the others need no check.
        let hopeless = exact + of_lobes(halves.middle()) > settings.max_error;
        let (precision, predicted_error) = match wanted.precision {
            Some(Precision::Float) => (Precision::Float, exact),
            None if hopeless => (Precision::Float, exact),
            wanted => {
                let halved = exact + of_lobes(halves.most(reach));
                let met = wanted.is_some() || halved <= settings.max_error;
                if met { (Precision::Half, halved) } else { (Precision::Float, exact) }
            }
        };
        let about = TermsAbout {
            kind: if expansion.kind == Kind::Taylor { "taylor" } else { "chebyshev" }.into(),
            terms: expansion.terms,
            precision,
            size_um: relief.size_um,
            half_um: relief.half_um,
            reach,
            x_most: expansion.high,
            extent: wanted.extent,
            predicted_error,
            formula: formula(expansion.kind),
        };
        Ok(Self { about, planes })
    }

    /// Amplitude of a term at a frequency in cycles per patch.
    pub fn amplitude(&self, term: usize, frequency: [isize; 2]) -> Complex32 {
        self.planes[term].at(frequency)
    }

    /// Functions of X, one per term.
    pub fn functions(&self, x: f64) -> Vec<f64> {
        let kind = if self.about.kind == "taylor" { Kind::Taylor } else { Kind::Chebyshev };
        let mut all = vec![0.0; self.about.terms];
        Expansion::with_terms(kind, 0.0, self.about.x_most, self.about.terms).coefficients(x, &mut all);
        all
    }

    /// Writes the set: one EXR per term (`re`, `im`) and a description.
    ///
    /// # Errors
    /// `Output` if the system refuses.
    pub fn write(&self, folder: &OutputFolder, progress: &dyn Progress) -> Result<()> {
        progress.stage("writing", self.planes.len() as u64);
        let side = self.about.reach.map(|r| 2 * r + 1);
        let mut values = vec![Complex32::ZERO; side[0] * side[1]];
        for (n, plane) in self.planes.iter().enumerate() {
            // Images begin with the highest frequency.
            let rows = values
                .chunks_mut(side[0])
                .zip((0..=2 * self.about.reach[1]).map(|y| self.about.reach[1] as isize - y as isize));
            rows.for_each(|(row, iy)| plane.row(iy, row));
            let attributes = [
                ("units", Attribute::Text("amplitude of an incident wave of amplitude 1".into())),
                ("term", Attribute::Number(n as f64)),
            ];
            let path = folder.path(&file_of(n));
            write_exr_as(&path, self.about.precision, side, &["re", "im"], &attributes, &|c, y, row| {
                let from = &values[y * side[0]..][..side[0]];
                row.iter_mut().zip(from).for_each(|(to, v)| *to = if c == 0 { v.re } else { v.im });
            })?;
            progress.step();
            progress.check()?;
        }
        folder.write_json(TERMS_FILE, &self.about)
    }
}

/// Rounding errors of amplitudes in half precision.
struct Halves<'a> {
    /// Largest absolute function of X of each term.
    most: Vec<f64>,
    planes: &'a [Plane<f32>],
}

impl<'a> Halves<'a> {
    fn new(expansion: &Expansion, planes: &'a [Plane<f32>]) -> Self {
        const SAMPLES: usize = 64;
        let mut most = vec![0.0_f64; expansion.terms];
        let mut here = vec![0.0; expansion.terms];
        for k in 0..=SAMPLES {
            expansion.coefficients(expansion.high * k as f64 / SAMPLES as f64, &mut here);
            most.iter_mut().zip(&here).for_each(|(m, c)| *m = m.max(c.abs()));
        }
        Self { most, planes }
    }

    /// Upper bound of the error at a frequency.
    fn of(&self, amplitude: impl Fn(&Plane<f32>) -> Complex32) -> f64 {
        let of = |(m, plane): (&f64, &Plane<f32>)| {
            m * (HALF[0] * f64::from(amplitude(plane).norm_sqr().sqrt()) + 2.0 * HALF[1])
        };
        self.most.iter().zip(self.planes).map(of).sum()
    }

    /// Upper bound of the error of the mean.
    fn middle(&self) -> f64 {
        self.of(|plane| plane.at([0, 0]))
    }

    /// Upper bound of the error at all frequencies; opposite frequencies have equal magnitudes.
    fn most(&self, reach: [usize; 2]) -> f64 {
        let [mx, my] = reach.map(|r| r as isize);
        let column = |ix: isize| (-my..=my).map(|iy| self.of(|plane| plane.at([ix, iy]))).fold(0.0, f64::max);
        (0..=mx).into_par_iter().map(column).reduce(|| 0.0, f64::max)
    }
}

impl Terms {
    /// Reads a set written by [`TermSet::write`].
    ///
    /// # Errors
    /// `Input` for a folder without a set, or with a damaged one.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(TERMS_FILE);
        let remedy = "give a folder that nacre brdf terms has written";
        let text = read_text(&path, MAX_BYTES, remedy)?;
        let about: TermsAbout =
            from_json(&text).map_err(|e| Error::file(&path, format!("is no description: {e}"), remedy))?;
        let bad = |problem: String| Err(Error::file(&path, problem, remedy));
        let kind = match about.kind.as_str() {
            "taylor" => Kind::Taylor,
            "chebyshev" => Kind::Chebyshev,
            other => return bad(format!("has terms of the kind {other:.40}")),
        };
        let positive = |v: f64| v.is_finite() && v > 0.0;
        if !(1..=MOST_TERMS).contains(&about.terms) || about.reach.iter().any(|r| *r > MOST_REACH) {
            return bad(format!("says {} terms and a reach of {:?}", about.terms, about.reach));
        }
        if ![about.size_um[0], about.size_um[1], about.half_um, about.x_most, about.extent].into_iter().all(positive) {
            return bad("has a size, a depth or a range that is not above 0".into());
        }
        let side = about.reach.map(|r| 2 * r + 1);
        let planes = (0..about.terms).map(|n| plane(&folder.join(file_of(n)), side)).collect::<Result<Vec<_>>>()?;
        let expansion = Expansion::with_terms(kind, 0.0, about.x_most, about.terms);
        let row = |n: usize, iy: isize, out: &mut [Complex32]| {
            let from = (iy + about.reach[1] as isize) as usize * side[0];
            out.copy_from_slice(&planes[n][from..][..side[0]]);
        };
        let bank = Bank::pack(expansion, (about.size_um, about.half_um), about.reach, 0.0, row);
        Ok(Self { about, bank })
    }

    /// Description of the set.
    pub fn about(&self) -> &TermsAbout {
        &self.about
    }

    /// Largest relative difference from direct sums over the original height field, at some points near lobes.
    ///
    /// # Errors
    /// `Input` for a coherence width out of range.
    pub fn measured(self, field: &HeightField, coherence_um: f64) -> Result<Option<f64>> {
        let window = Window::new(coherence_um)?;
        // Grazing light and viewing directions leave nothing to compare.
        let q = request(self.about.extent).q;
        let request = Request { q: [0.1 * q[1], q[1]], ..request(self.about.extent) };
        let radius = window.radius(OUTSIDE);
        let model = Model { engine: Engine::Single(self.bank), window, radius, lattice: None };
        Ok(measured(field, &model, &request, Method::Chebyshev))
    }
}

/// Plane of a term, from the lowest frequency.
fn plane(path: &Path, [width, height]: [usize; 2]) -> Result<Vec<Complex32>> {
    let mut map = read_exr(path)?;
    if [map.width, map.height] != [width, height] {
        let problem =
            format!("has {} × {} numbers, and the description says {width} × {height}", map.width, map.height);
        return Err(Error::file(path, problem, "write the set again"));
    }
    let (re, im) = (map.take("re", path)?, map.take("im", path)?);
    if re.iter().chain(&im).any(|v| !v.is_finite()) {
        return Err(Error::file(path, "holds numbers that are not finite", "write the set again"));
    }
    let rows = re.chunks(width).zip(im.chunks(width)).rev();
    Ok(rows.flat_map(|(re, im)| re.iter().zip(im).map(|(re, im)| Complex32::new(*re, *im))).collect())
}
