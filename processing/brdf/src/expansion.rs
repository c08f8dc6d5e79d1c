//! Expansions of `exp(-iXt)`, -1 ≤ t ≤ 1, as sums of products of a function of X and a function of t.
//!
//! X is `k(cos θi + cos θr)` times half the range of heights, and t is the normalised height. The transforms of the
//! functions of t are computed once per patch. A pair of directions and a wavelength then need the functions of X only.

use super::transform::Real;
use num_complex::{Complex, Complex64};
use pulp::Arch;
use serde::Serialize;
use std::f64::consts::PI;

/// Largest number of terms: a depth of 60 µm at 380 nm.
pub const MOST_TERMS: usize = 600;

/// Kind of expansion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Kind {
    /// Powers (2014 thesis, section 3.3: FLSS). The terms grow to e^X before they cancel.
    Taylor,
    /// Chebyshev polynomials with Bessel functions (Jacobi-Anger expansion): stable at any depth.
    Chebyshev,
    /// The exponential at some values of X (nodes), with polynomial interpolation between them.
    Nodes,
}

/// Expansion for `low ≤ X ≤ high`.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Expansion {
    pub kind: Kind,
    pub low: f64,
    pub high: f64,
    pub terms: usize,
    /// X of the nodes, and their barycentric weights.
    nodes: Vec<[f64; 2]>,
}

/// Bessel functions J0 to J(n-1) of x ≥ 0, by Miller's backward recurrence.
pub(super) fn bessel(x: f64, out: &mut [f64]) {
    out.fill(0.0);
    if x < 1e-12 {
        out[0] = 1.0;
        out.iter_mut().skip(1).take(1).for_each(|j| *j = 0.5 * x);
        return;
    }
    // Starts far enough above both x and n for the start value to be forgotten.
    let top = (out.len() as f64).max(x);
    let start = (top + 12.0 + 10.0 * top.cbrt()) as usize / 2 * 2;
    let (mut above, mut here, mut sum) = (0.0, 1e-280_f64, 0.0);
    for k in (0..=start).rev() {
        // here is proportional to J_k.
        if k < out.len() {
            out[k] = here;
        }
        if k % 2 == 0 {
            sum += if k == 0 { here } else { 2.0 * here };
        }
        if k == 0 {
            break;
        }
        let below = 2.0 * k as f64 / x * here - above;
        (above, here) = (here, below);
        if here.abs() > 1e200 {
            for v in [&mut above, &mut here, &mut sum] {
                *v *= 1e-200;
            }
            let first = k.min(out.len());
            out[first..].iter_mut().for_each(|v| *v *= 1e-200);
        }
    }
    out.iter_mut().for_each(|v| *v /= sum);
}

/// Number of terms of the Chebyshev expansion for a truncation error below `error`, bounded by `2 Σ |Jn(X)|` of the
/// omitted ones; `None` above 600.
pub fn chebyshev_terms(x: f64, error: f64) -> Option<usize> {
    let mut all = vec![0.0; (x + 60.0 + 12.0 * x.cbrt()) as usize + 2];
    if x > MOST_TERMS as f64 {
        return None;
    }
    bessel(x, &mut all);
    let mut rest = 0.0;
    let mut terms = all.len();
    while terms > 1 {
        let next = rest + 2.0 * all[terms - 1].abs();
        if next > error {
            break;
        }
        (rest, terms) = (next, terms - 1);
    }
    (terms <= MOST_TERMS && terms < all.len()).then_some(terms)
}

/// Number of terms of the Taylor expansion for a truncation error below `error`; `None` if the rounding error exceeds
/// it.
///
/// The terms reach e^X before they cancel, and `epsilon` is their relative precision.
pub fn taylor_terms(x: f64, error: f64, epsilon: f64) -> Option<usize> {
    if taylor_rounding(x, epsilon) > error {
        return None;
    }
    let (mut term, mut n) = (1.0_f64, 0_usize);
    loop {
        // Lagrange's remainder: every derivative of exp(-iX) is at most 1.
        if n > 0 && term <= error {
            return Some(n);
        }
        n += 1;
        term *= x / n as f64;
        if n > MOST_TERMS {
            return None;
        }
    }
}

/// Rounding error of the Taylor expansion: ε times its largest term, `e^X/√(2πX)`.
pub(super) fn taylor_rounding(x: f64, epsilon: f64) -> f64 {
    x.min(700.0).exp() / (1.0 + 2.0 * PI * x).sqrt() * epsilon
}

impl Expansion {
    /// Shortest expansion of its kind with a truncation error below `error` (relative to an amplitude of 1); `None` if
    /// there is none.
    pub(super) fn new(kind: Kind, low: f64, high: f64, error: f64, epsilon: f64) -> Option<Self> {
        let terms = match kind {
            Kind::Taylor => taylor_terms(high, error, epsilon)?,
            Kind::Chebyshev => chebyshev_terms(high, error)?,
            // Interpolation doubles the truncation error by aliasing.
            Kind::Nodes => chebyshev_terms(0.5 * (high - low), 0.5 * error)?,
        };
        Some(Self::with_terms(kind, low, high, terms))
    }

    /// Expansion with this number of terms.
    pub(super) fn with_terms(kind: Kind, low: f64, high: f64, terms: usize) -> Self {
        let angle = |k: usize| PI * (k as f64 + 0.5) / terms as f64;
        let node = |k: usize| {
            let sign = if k.is_multiple_of(2) { 1.0 } else { -1.0 };
            [0.5 * (low + high) + 0.5 * (high - low) * angle(k).cos(), sign * angle(k).sin()]
        };
        let nodes = if kind == Kind::Nodes { (0..terms).map(node).collect() } else { vec![] };
        Self { kind, low, high, terms, nodes }
    }

    /// Truncation error, relative to an amplitude of 1.
    pub(super) fn error(&self) -> f64 {
        let rest = |x: f64, from: usize| {
            let mut all = vec![0.0; from + 40 + (x + 6.0 * x.cbrt()) as usize];
            bessel(x, &mut all);
            all[from..].iter().map(|j| 2.0 * j.abs()).sum::<f64>()
        };
        match self.kind {
            Kind::Taylor => (1..=self.terms).fold(1.0, |term, n| term * self.high / n as f64),
            Kind::Chebyshev => rest(self.high, self.terms),
            Kind::Nodes => 2.0 * rest(0.5 * (self.high - self.low), self.terms),
        }
    }

    /// Error due to rounding with relative precision `epsilon`.
    pub(super) fn rounding(&self, epsilon: f64) -> f64 {
        match self.kind {
            Kind::Taylor => taylor_rounding(self.high, epsilon),
            // Transforms and sums of this number of values near 1.
            Kind::Chebyshev | Kind::Nodes => 8.0 * epsilon * (self.terms as f64).sqrt(),
        }
    }

    /// Whether the functions of t are real. The transforms of complex ones cost twice as much.
    pub(super) fn is_real(&self) -> bool {
        self.kind != Kind::Nodes
    }

    /// Evaluates the functions of X, one per term, all real.
    pub(super) fn coefficients(&self, x: f64, out: &mut [f64]) {
        match self.kind {
            Kind::Taylor => {
                let mut power = 1.0;
                for c in out.iter_mut() {
                    *c = power;
                    power *= x / self.high;
                }
            }
            Kind::Chebyshev => {
                bessel(x, out);
                out[1..].iter_mut().for_each(|c| *c *= 2.0);
            }
            Kind::Nodes => self.barycentric(x, out),
        }
    }

    /// Lagrange polynomials through the nodes.
    fn barycentric(&self, x: f64, out: &mut [f64]) {
        if let Some(at) = self.nodes.iter().position(|n| (x - n[0]).abs() < 1e-13 * self.high.max(1.0)) {
            out.fill(0.0);
            out[at] = 1.0;
            return;
        }
        let mut sum = 0.0;
        for (c, [node, weight]) in out.iter_mut().zip(&self.nodes) {
            *c = weight / (x - node);
            sum += *c;
        }
        out.iter_mut().for_each(|c| *c /= sum);
    }

    /// Evaluates the functions of t of real expansions except that of term 0, which is 1. Each is multiplied by
    /// [`Self::factor`] later.
    ///
    /// Line k of `lines` (at a distance of `stride` numbers) gets the terms `2 (first + k) + 1` and the next, as real
    /// and imaginary parts. Lines must have room for all heights in groups of eight. `t` maps heights to -1 to 1.
    ///
    /// The recurrence is in double precision; single precision would lose n² roundings at the ends.
    pub(super) fn pairs<T: Real>(
        &self,
        heights: &[f64],
        t: impl Fn(f64) -> f64,
        first: usize,
        stride: usize,
        lines: &mut [Complex<T>],
    ) {
        // T(n+1) = 2 t T(n) - T(n-1); powers lack the second term.
        let [scale, back] = if self.kind == Kind::Taylor { [1.0, 0.0] } else { [2.0, 1.0] };
        Arch::new().dispatch(|| {
            for (k, group) in heights.chunks(8).enumerate() {
                let mut at = [0.0; 8];
                at.iter_mut().zip(group).for_each(|(to, from)| *to = t(*from));
                // Terms n and n - 1.
                let (mut here, mut last) = (at, [1.0; 8]);
                let step = |here: &mut [f64; 8], last: &mut [f64; 8]| {
                    for i in 0..8 {
                        (here[i], last[i]) = (scale * at[i] * here[i] - back * last[i], here[i]);
                    }
                };
                for _ in 0..2 * first {
                    step(&mut here, &mut last);
                }
                for line in lines.chunks_mut(stride) {
                    step(&mut here, &mut last);
                    let to = &mut line[8 * k..][..8];
                    for i in 0..8 {
                        to[i] = Complex::new(T::of(last[i]), T::of(here[i]));
                    }
                    step(&mut here, &mut last);
                }
            }
        });
    }

    /// Factor of a real term: powers of -i, and `Xⁿ/n!` at the largest X for powers, whose coefficients are powers of X
    /// relative to it.
    pub(super) fn factor(&self, term: usize) -> Complex64 {
        let turn = Complex64::new(0.0, -1.0).powi(term as i32);
        let size = if self.kind == Kind::Taylor { (1..=term).fold(1.0, |f, n| f * self.high / n as f64) } else { 1.0 };
        turn * size
    }

    /// X of a node.
    pub(super) fn node(&self, term: usize) -> f64 {
        self.nodes[term][0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest error of an expansion at an X.
    fn worst(e: &Expansion, x: f64) -> f64 {
        let t: Vec<f64> = (0..=200).map(|k| f64::from(k) / 100.0 - 1.0).collect();
        let mut c = vec![0.0; e.terms];
        e.coefficients(x, &mut c);
        let mut sum = vec![Complex64::new(0.0, 0.0); t.len()];
        if e.is_real() {
            let stride = t.len().next_multiple_of(8);
            let pairs = e.terms / 2;
            let mut lines = vec![Complex64::new(0.0, 0.0); stride * pairs];
            // In two parts, as for large patches; heights from 1 to 5.
            let heights: Vec<f64> = t.iter().map(|t| 2.0 * t + 3.0).collect();
            let (low, high) = lines.split_at_mut(stride * (pairs / 2));
            e.pairs(&heights, |h| 0.5 * (h - 3.0), 0, stride, low);
            e.pairs(&heights, |h| 0.5 * (h - 3.0), pairs / 2, stride, high);
            sum.fill(e.factor(0) * c[0]);
            for (n, c) in c.iter().enumerate().skip(1) {
                let factor = e.factor(n) * c;
                let line = &lines[(n - 1) / 2 * stride..][..t.len()];
                let value = |z: &Complex64| if n % 2 == 1 { z.re } else { z.im };
                sum.iter_mut().zip(line).for_each(|(s, z)| *s += factor * value(z));
            }
        } else {
            for (n, c) in c.iter().enumerate() {
                let node = e.node(n);
                sum.iter_mut().zip(&t).for_each(|(s, t)| *s += Complex64::from_polar(*c, -node * t));
            }
        }
        let off = |(s, t): (&Complex64, &f64)| (s - Complex64::from_polar(1.0, -x * t)).norm();
        sum.iter().zip(&t).map(off).fold(0.0, f64::max)
    }

    #[test]
    fn bessel_functions_are_those_of_the_library() {
        for x in [1e-13, 1e-3, 0.7, 2.4, 10.0, 33.0, 132.0, 300.0] {
            let mut all = vec![0.0; 200];
            bessel(x, &mut all);
            for (n, j) in all.iter().enumerate() {
                let truth = libm::jn(n as i32, x);
                assert!((j - truth).abs() < 2e-14, "J{n}({x}): {j} {truth}");
            }
        }
    }

    #[test]
    fn terms_are_those_of_the_notes() {
        // Highest powers for 1 % at 380 nm and w = 2, by height range; "never" means cancellation.
        let x = |range_um: f64| 4.0 * PI / 0.38 * range_um;
        let highest = |terms: Option<usize>| terms.map(|n| n - 1);
        let double = f64::EPSILON;
        for (range, plain, single, centered, chebyshev) in [
            (0.15, Some(15), Some(15), Some(8), 5),
            (0.5, Some(46), None, Some(24), 13),
            (1.0, Some(91), None, Some(46), 22),
            (2.0, None, None, Some(91), 40),
            (4.0, None, None, None, 74),
        ] {
            assert_eq!(highest(taylor_terms(x(range), 0.01, double)), plain, "{range}");
            assert_eq!(highest(taylor_terms(x(range), 0.01, f64::from(f32::EPSILON))), single, "{range} f32");
            assert_eq!(highest(taylor_terms(0.5 * x(range), 0.01, double)), centered, "{range} centred");
            // The bound ignores signs, which costs one term at 4 µm; the number of the physics notes suffices.
            let bound = highest(chebyshev_terms(0.5 * x(range), 0.01)).unwrap();
            assert!(bound == chebyshev || (range == 4.0 && bound == 75), "{range}: {bound}");
            let e = Expansion::with_terms(Kind::Chebyshev, 0.0, 0.5 * x(range), chebyshev + 1);
            assert!(worst(&e, e.high) < 0.01 && worst(&e, e.high) > 1e-3, "{range}");
        }
    }

    #[test]
    fn expansions_meet_their_bounds() {
        for (kind, low, high) in [
            (Kind::Taylor, 1.0, 12.0),
            (Kind::Chebyshev, 1.0, 12.0),
            (Kind::Chebyshev, 10.0, 66.0),
            (Kind::Nodes, 3.0, 12.0),
            (Kind::Nodes, 10.0, 66.0),
        ] {
            for error in [1e-2, 1e-4, 1e-8] {
                let e = Expansion::new(kind, low, high, error, f64::EPSILON).unwrap();
                assert!(e.error() <= error * 1.001, "{kind:?} {}", e.error());
                let along = (0..=50).map(|k| worst(&e, low + (high - low) * f64::from(k) / 50.0));
                let worst = along.fold(0.0, f64::max);
                let floor = e.rounding(f64::EPSILON);
                assert!(worst <= error + floor && worst.is_finite(), "{kind:?} {error}: {worst}");
                // The expansion is not wasteful: its error is at least a thousandth of the bound.
                assert!(worst > error * 1e-3 || worst < 1e-9, "{kind:?} {error}: {worst}");
            }
        }
        assert!(Expansion::new(Kind::Taylor, 1.0, 66.0, 1e-2, f64::EPSILON).is_none());
        assert!(Expansion::new(Kind::Chebyshev, 1.0, 1e4, 1e-2, f64::EPSILON).is_none());
    }
}
