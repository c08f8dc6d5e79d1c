//! Exact order efficiencies of one-dimensional gratings: `|c_m|²` of the Fourier series of `exp(-iqh)` (2018 paper,
//! section 3.2). The paper's second-order Taylor lobes are included for comparison.

use super::expansion::bessel;
use super::height::Profile;
use nacre_base::text::read_text;
use nacre_base::{Error, Result};
use num_complex::Complex64;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use std::path::Path;

/// Largest cross-section file in bytes, and largest number of its points.
const MAX_BYTES: u64 = 4 << 20;
const MAX_POINTS: usize = 100_000;

/// Number of positions at which slopes are evaluated.
const SLOPES: u32 = 4096;

/// Cross-section over one period.
#[derive(Clone, Debug, PartialEq)]
pub enum Section {
    /// Formula, from 0 to `depth_um`.
    Formula {
        /// Shape of the profile.
        profile: Profile,
        /// Peak-to-peak depth in µm.
        depth_um: f64,
    },
    /// Piecewise linear profile: positions (0 to 1 period, increasing) and heights in µm, closed from the last to the
    /// first.
    Lines(Vec<[f64; 2]>),
}

/// Computation of order efficiencies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OrderMethod {
    /// `|c_m|²`: exact, with a sum of 1.
    #[default]
    Exact,
    /// `exp(-iqh)` as `1 - iqh - (qh)²/2` (2018 paper, Eq. 2), for sinusoids of a few tens of nm only; the sum exceeds
    /// 1.
    Taylor2,
}

impl Section {
    /// Reads a cross-section from rows `x_um,height_um` over one period, evenly spaced or not.
    ///
    /// # Errors
    /// `Input` for a file that is not a cross-section.
    pub fn read(path: &Path, period_um: f64) -> Result<Self> {
        let remedy = "give a CSV file with rows \"x_um,height_um\" over one period, x rising";
        let bad = |problem: String| Error::file(path, problem, remedy);
        let text = read_text(path, MAX_BYTES, remedy)?;
        let mut points: Vec<[f64; 2]> = vec![];
        for (k, line) in text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty()) {
            let numbers: Vec<Option<f64>> = line.split([',', ';', '\t']).map(|v| v.trim().parse().ok()).collect();
            match numbers.as_slice() {
                [Some(x), Some(h)] if x.is_finite() && h.abs() < 1e3 => points.push([x / period_um, *h]),
                _ if k == 0 => {}
                _ => return Err(bad(format!("line {} is not \"x_um,height_um\": {line:.60}", k + 1))),
            }
            if points.len() > MAX_POINTS {
                return Err(bad(format!("has more than {MAX_POINTS} rows")));
            }
        }
        let first = points.first().map_or(0.0, |p| p[0]);
        points.iter_mut().for_each(|p| p[0] -= first);
        if points.len() < 2 {
            return Err(bad("has less than two rows of numbers".into()));
        }
        if let Some([a, b]) = points.array_windows().find(|[a, b]| a[0] > b[0]) {
            return Err(bad(format!("goes back from {} to {} µm", a[0] * period_um, b[0] * period_um)));
        }
        let last = points.last().map_or(0.0, |p| p[0]);
        if last > 1.0 + 1e-9 {
            return Err(bad(format!("is {} µm long, more than a period of {period_um} µm", last * period_um)));
        }
        Ok(Self::Lines(points))
    }

    /// Peak-to-peak depth in µm.
    pub fn depth_um(&self) -> f64 {
        match self {
            Self::Formula { depth_um, .. } => *depth_um,
            Self::Lines(points) => {
                let ends =
                    points.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], p| [a.min(p[1]), b.max(p[1])]);
                ends[1] - ends[0]
            }
        }
    }

    /// Height in µm at a position of 0 to 1 periods.
    fn height(&self, t: f64) -> f64 {
        match self {
            Self::Formula { profile: Profile::Sinusoid, depth_um } => 0.5 * depth_um * (1.0 + (TAU * t).cos()),
            Self::Formula { profile: Profile::Blazed, depth_um } => depth_um * t,
            Self::Formula { profile: Profile::Rectangular { duty }, depth_um } if t < *duty => *depth_um,
            Self::Formula { .. } => 0.0,
            Self::Lines(points) => {
                let k = points.partition_point(|p| p[0] <= t);
                let (Some(first), Some(from)) = (points.first(), points.get(k.saturating_sub(1))) else { return 0.0 };
                let to = points.get(k).copied().unwrap_or([1.0, first[1]]);
                from[1] + (to[1] - from[1]) * ((t - from[0]) / (to[0] - from[0]).max(1e-12)).clamp(0.0, 1.0)
            }
        }
    }

    /// Mean square slope for a period in µm, from heights at a distance of `apart_um`, so that a wall has a finite
    /// slope.
    pub fn mean_square_slope(&self, period_um: f64, apart_um: f64) -> f64 {
        let apart = apart_um / period_um;
        let places = (0..SLOPES).map(|k| (f64::from(k) + 0.5) / f64::from(SLOPES));
        let sum: f64 = places.map(|t| (self.height((t + apart).fract()) - self.height(t)).powi(2)).sum();
        sum / f64::from(SLOPES) / (apart_um * apart_um)
    }

    /// `c_m = ∫₀¹ exp(-i q h(t) - 2πi m t) dt` for the orders `-most..=most`, with q in 1/µm.
    pub fn amplitudes(&self, q: f64, most: usize) -> Vec<Complex64> {
        let orders = -(most as i32)..=most as i32;
        match self {
            Self::Formula { profile: Profile::Sinusoid, depth_um } => {
                let mut j = vec![0.0; most + 1];
                bessel(0.5 * q * depth_um, &mut j);
                let turn = Complex64::from_polar(1.0, -0.5 * q * depth_um);
                // Jacobi-Anger expansion: exp(-iX cos) = Σ (-i)^m J_m exp(im·).
                orders.map(|m| turn * Complex64::new(0.0, -1.0).powi(m.abs()) * j[m.unsigned_abs() as usize]).collect()
            }
            Self::Formula { profile: Profile::Blazed, depth_um } => {
                orders.map(|m| segment([0.0, 0.0], [1.0, *depth_um], q, m)).collect()
            }
            Self::Formula { profile: Profile::Rectangular { duty }, depth_um } => {
                let flat = |from: f64, to: f64, h: f64, m: i32| segment([from, h], [to, h], q, m);
                orders.map(|m| flat(0.0, *duty, *depth_um, m) + flat(*duty, 1.0, 0.0, m)).collect()
            }
            Self::Lines(points) => {
                let close = points.first().map(|p| [1.0, p[1]]);
                let all: Vec<[f64; 2]> = points.iter().copied().chain(close).collect();
                orders.map(|m| all.array_windows().map(|[a, b]| segment(*a, *b, q, m)).sum()).collect()
            }
        }
    }

    /// Efficiencies of the orders `-most..=most`.
    ///
    /// # Errors
    /// `Input` if the Taylor lobes are requested for a profile other than a sinusoid.
    pub fn efficiencies(&self, q: f64, most: usize, method: OrderMethod) -> Result<Vec<f64>> {
        match (method, self) {
            (OrderMethod::Exact, _) => Ok(self.amplitudes(q, most).iter().map(|c| c.norm_sqr()).collect()),
            (OrderMethod::Taylor2, Self::Formula { profile: Profile::Sinusoid, depth_um }) => {
                // h = X/q (1 + cos): the constant part and the first and second harmonic.
                let x = 0.5 * q * depth_um;
                let square = x * x;
                let lobes = [
                    (1.0 - 0.75 * square).powi(2) + square,
                    0.25 * square + 0.25 * square * square,
                    square * square / 64.0,
                ];
                let of = |m: i32| lobes.get(m.unsigned_abs() as usize).copied().unwrap_or(0.0);
                Ok((-(most as i32)..=most as i32).map(of).collect())
            }
            _ => Err(Error::input("method taylor2", "is for sinusoids only", "choose exact, or --profile sinusoid")),
        }
    }
}

/// `∫ exp(-i(q h + 2π m t)) dt` over a straight line.
fn segment([t0, h0]: [f64; 2], [t1, h1]: [f64; 2], q: f64, m: i32) -> Complex64 {
    let turn = |t: f64, h: f64| q * h + TAU * f64::from(m) * t;
    let (a, b) = (turn(t0, h0), turn(t1, h1));
    let half = 0.5 * (b - a);
    // The mean of exp over a linear phase is sin x / x times exp at its middle.
    let sinc = if half.abs() < 1e-8 { 1.0 - half * half / 6.0 } else { half.sin() / half };
    Complex64::from_polar((t1 - t0) * sinc, -0.5 * (a + b))
}

/// Largest significant order for a depth. Beyond, `J_m(X)` vanishes; profiles with edges fall off as 1/m².
pub fn most_orders(q: f64, depth_um: f64) -> usize {
    let x = 0.5 * q * depth_um;
    (x + 20.0 + 6.0 * x.cbrt()).ceil() as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn formula(profile: Profile, depth_um: f64) -> Section {
        Section::Formula { profile, depth_um }
    }

    #[test]
    fn sinusoids_have_bessel_efficiencies_that_add_up_to_one() {
        for depth in [0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0] {
            for nm in [380.0, 550.0, 780.0] {
                let q = 2.0 * TAU * 1e3 / nm;
                let most = most_orders(q, depth);
                let all = formula(Profile::Sinusoid, depth).efficiencies(q, most, OrderMethod::Exact).unwrap();
                for (k, found) in all.iter().enumerate() {
                    let truth = libm::jn((k as i32 - most as i32).abs(), 0.5 * q * depth).powi(2);
                    assert!((found - truth).abs() < 1e-6, "{depth} {nm} {k}");
                }
                assert!((all.iter().sum::<f64>() - 1.0).abs() < 1e-9, "{depth} {nm}");
            }
        }
    }

    #[test]
    fn the_papers_taylor_lobes_gain_light() {
        // Physics notes: 1.12, 2.86 and 30.8 times the incident light.
        for (depth, truth) in [(0.05, 1.12), (0.1, 2.86), (0.2, 30.8)] {
            let q = 2.0 * TAU / 0.55;
            let sum: f64 =
                formula(Profile::Sinusoid, depth).efficiencies(q, 5, OrderMethod::Taylor2).unwrap().iter().sum();
            assert!((sum / truth - 1.0).abs() < 0.005, "{depth}: {sum}");
        }
        assert!(formula(Profile::Blazed, 0.1).efficiencies(1.0, 5, OrderMethod::Taylor2).is_err());
    }

    #[test]
    fn profiles_agree_with_numerical_integrals() {
        let lines = Section::Lines(vec![[0.0, 0.1], [0.2, 0.5], [0.2, 0.0], [0.7, 0.3]]);
        let height = |t: f64| -> f64 {
            if t < 0.2 {
                0.1 + 2.0 * t
            } else if t < 0.7 {
                0.6 * (t - 0.2)
            } else {
                0.3 - (t - 0.7) * 2.0 / 3.0
            }
        };
        let blazed = |t: f64| 0.4 * t;
        let steps = |t: f64| if t < 0.3 { 0.25 } else { 0.0 };
        let rectangular = formula(Profile::Rectangular { duty: 0.3 }, 0.25);
        let all: [(&Section, &dyn Fn(f64) -> f64); 3] =
            [(&lines, &height), (&formula(Profile::Blazed, 0.4), &blazed), (&rectangular, &steps)];
        for (section, height) in all {
            for (k, c) in section.amplitudes(27.0, 6).iter().enumerate() {
                let m = k as f64 - 6.0;
                let n = 20_000;
                let truth: Complex64 = (0..n)
                    .map(|i| (f64::from(i) + 0.5) / f64::from(n))
                    .map(|t| Complex64::from_polar(1.0 / f64::from(n), -27.0 * height(t) - TAU * m * t))
                    .sum();
                assert!((c - truth).norm() < 2e-6, "{section:?} {m}");
            }
            let sum: f64 = section.amplitudes(27.0, 20_000).iter().map(|c| c.norm_sqr()).sum();
            assert!((sum - 1.0).abs() < 1e-3, "{section:?}: {sum}");
        }
    }

    #[test]
    fn a_blaze_of_half_a_wavelength_puts_all_light_into_one_order() {
        // q d = 2π: the order -1, on the side that the facets face, has all the light.
        let all = formula(Profile::Blazed, 0.25).efficiencies(TAU / 0.25, 3, OrderMethod::Exact).unwrap();
        assert!((all[2] - 1.0).abs() < 1e-12 && all.iter().sum::<f64>() < 1.0 + 1e-9, "{all:?}");
    }

    #[test]
    fn sections_that_make_no_sense_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.csv");
        for (text, word) in [
            ("", "two rows"),
            ("x,h\n0,0\n0.5,nan", "line 3"),
            ("1,0\n0,0", "back"),
            ("0,0\n9,1", "longer"),
            ("0,0\nno", "line 2"),
        ] {
            std::fs::write(&path, text).unwrap();
            let problem = Section::read(&path, 2.0).unwrap_err().to_string();
            assert!(
                problem.contains(word) || (word == "longer" && problem.contains("more than a period")),
                "{text}: {problem}"
            );
        }
        std::fs::write(&path, "x_um,height_um\n1,0\n2,0.25\n").unwrap();
        assert_eq!(Section::read(&path, 2.0).unwrap(), Section::Lines(vec![[0.0, 0.0], [0.5, 0.25]]));
    }

    /// Closed forms; the slope of a wall is finite, because heights have a finite distance.
    #[test]
    fn slopes_are_those_of_the_formulas() {
        let of = |profile| Section::Formula { profile, depth_um: 0.2 }.mean_square_slope(2.0, 0.05);
        let cases = [
            (of(Profile::Sinusoid), 0.5 * (0.5 * TAU * 0.1_f64).powi(2)),
            (of(Profile::Blazed), 0.975 * 0.1_f64.powi(2) + (0.2 * 0.975_f64).powi(2) / (0.05 * 2.0)),
            (of(Profile::Rectangular { duty: 0.3 }), 2.0 * 0.04 / (0.05 * 2.0)),
            (Section::Lines(vec![[0.0, 0.0], [0.5, 0.2]]).mean_square_slope(2.0, 0.002), 0.2_f64.powi(2)),
        ];
        for (found, wanted) in cases {
            assert!((found / wanted - 1.0).abs() < 0.03, "{found} {wanted}");
        }
    }
}
