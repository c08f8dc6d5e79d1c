//! Scattering base: Lambert below Cook and Torrance (1982) with the GGX distribution (Walter et al. 2007), Smith's
//! shadowing and Schlick's Fresnel.
//!
//! A second lobe restores the light of multiple reflections between microfacets (Kulla and Conty 2017). The diffuse
//! part receives the light that neither lobe reflects, in and out. Energy is therefore conserved for an albedo or a
//! specular reflectance of 1.

use std::f64::consts::PI;
use std::sync::LazyLock;

/// Points of the tables along cos θ and along the square root of α.
pub(crate) const COSINES: usize = 33;
pub(crate) const ALPHAS: usize = 17;

/// Directions per point.
const SAMPLES: usize = 4096;

/// Base parameters at a point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surface {
    /// Diffuse reflectance, linear sRGB.
    pub albedo: [f64; 3],
    /// Reflectance of the glossy part at normal incidence.
    pub specular: [f64; 3],
    pub alpha: f64,
}

/// Directional albedo of the distribution, as `F0 · a + b`, over cos θ and α; and its mean over directions.
struct Tables {
    a: Vec<f64>,
    b: Vec<f64>,
    mean: Vec<f64>,
    /// Mean of `b` alone.
    mean_b: Vec<f64>,
}

static TABLES: LazyLock<Tables> = LazyLock::new(Tables::new);

/// The tables, over [`COSINES`] and, row by row, [`ALPHAS`] roots of α: `a`, `b`, and the means of `a + b` and of `b`.
pub(crate) fn tables() -> Vec<[f64; 4]> {
    let t = &*TABLES;
    (0..COSINES * ALPHAS).map(|k| [t.a[k], t.b[k], t.mean[k / COSINES], t.mean_b[k / COSINES]]).collect()
}

fn alpha_of(k: usize) -> f64 {
    (0.02 + 0.98 * (k as f64 / (ALPHAS - 1) as f64).powi(2)).min(1.0)
}

impl Tables {
    fn new() -> Self {
        let mut tables = Self { a: vec![], b: vec![], mean: vec![], mean_b: vec![] };
        for j in 0..ALPHAS {
            let alpha = alpha_of(j);
            for i in 0..COSINES {
                let cos = (i as f64 / (COSINES - 1) as f64).max(1e-3);
                let (mut all, mut edge) = (0.0, 0.0);
                for k in 0..SAMPLES {
                    let u = [(k as f64 + 0.5) / SAMPLES as f64, (k as f64 * 0.618_033_988_75).fract()];
                    let view = [(1.0 - cos * cos).sqrt(), 0.0, cos];
                    let half = visible_normal(view, alpha, u);
                    let dot: f64 = (0..3).map(|c| view[c] * half[c]).sum();
                    let z = 2.0 * dot * half[2] - cos;
                    if z > 0.0 {
                        let weight = both(cos, z, alpha) / one(cos, alpha);
                        all += weight;
                        edge += weight * (1.0 - dot).clamp(0.0, 1.0).powi(5);
                    }
                }
                let (all, edge) = (all / SAMPLES as f64, edge / SAMPLES as f64);
                tables.a.push(all - edge);
                tables.b.push(edge);
            }
            // E is linear between points: ∫ (e0 + (e1 - e0) t) µ dµ is exact.
            let row = |t: &[f64]| t[j * COSINES..(j + 1) * COSINES].to_vec();
            let mean = |e: &[f64]| -> f64 {
                let d = 1.0 / (COSINES - 1) as f64;
                e.windows(2)
                    .enumerate()
                    .map(|(i, w)| {
                        let x = i as f64 * d;
                        2.0 * d * (w[0] * (0.5 * x + d / 6.0) + w[1] * (0.5 * x + d / 3.0))
                    })
                    .sum()
            };
            let (a, b) = (mean(&row(&tables.a)), mean(&row(&tables.b)));
            tables.mean.push(a + b);
            tables.mean_b.push(b);
        }
        tables
    }

    /// `a`, `b`, and the means of `a + b` and of `b`.
    fn at(&self, cos: f64, alpha: f64) -> [f64; 4] {
        let y = ((alpha - 0.02).max(0.0) / 0.98).sqrt().min(1.0) * (ALPHAS - 1) as f64;
        let x = cos.clamp(0.0, 1.0) * (COSINES - 1) as f64;
        let (j, i) = ((y as usize).min(ALPHAS - 2), (x as usize).min(COSINES - 2));
        let (v, u) = (y - j as f64, x - i as f64);
        let table = |t: &[f64]| {
            let row = |j: usize| t[j * COSINES + i] * (1.0 - u) + t[j * COSINES + i + 1] * u;
            row(j) * (1.0 - v) + row(j + 1) * v
        };
        let line = |t: &[f64]| t[j] * (1.0 - v) + t[j + 1] * v;
        [table(&self.a), table(&self.b), line(&self.mean), line(&self.mean_b)]
    }
}

/// Smith's Λ.
fn lambda(cos: f64, alpha: f64) -> f64 {
    let tan = (1.0 - cos * cos).max(0.0) / (cos * cos).max(1e-12);
    0.5 * ((1.0 + alpha * alpha * tan).sqrt() - 1.0)
}

fn one(cos: f64, alpha: f64) -> f64 {
    1.0 / (1.0 + lambda(cos, alpha))
}

fn both(i: f64, o: f64, alpha: f64) -> f64 {
    1.0 / (1.0 + lambda(i, alpha) + lambda(o, alpha))
}

fn distribution(cos: f64, alpha: f64) -> f64 {
    let a = alpha * alpha;
    let d = cos * cos * (a - 1.0) + 1.0;
    a / (PI * d * d)
}

/// Samples a microfacet normal in proportion to its visibility from a direction (Heitz 2018).
fn visible_normal([x, y, z]: [f64; 3], alpha: f64, u: [f64; 2]) -> [f64; 3] {
    let unit = |v: [f64; 3]| {
        let n = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
        v.map(|c| c / n)
    };
    let v = unit([alpha * x, alpha * y, z]);
    let across = v[0].hypot(v[1]);
    let s = if across > 1e-12 { [-v[1] / across, v[0] / across, 0.0] } else { [1.0, 0.0, 0.0] };
    let t = [v[1] * s[2] - v[2] * s[1], v[2] * s[0] - v[0] * s[2], v[0] * s[1] - v[1] * s[0]];
    let (radius, phi) = (u[0].sqrt(), 2.0 * PI * u[1]);
    let p = radius * phi.cos();
    let share = 0.5 * (1.0 + v[2]);
    let q = (1.0 - share) * (1.0 - p * p).max(0.0).sqrt() + share * radius * phi.sin();
    let up = (1.0 - p * p - q * q).max(0.0).sqrt();
    let n = [0, 1, 2].map(|c| p * s[c] + q * t[c] + up * v[c]);
    unit([alpha * n[0], alpha * n[1], n[2].max(0.0)])
}

impl Surface {
    /// Reflectance of the glossy part at a direction, and its mean over directions, including multiple reflections.
    fn glossy(&self, cos: f64) -> [[f64; 2]; 3] {
        let [a, b, mean, mean_b] = TABLES.at(cos, self.alpha);
        self.specular.map(|f0| {
            let again = self.again(f0, mean);
            [
                f0 * a + b_part(f0, b) + again * (1.0 - a - b),
                f0 * (mean - mean_b) + b_part(f0, mean_b) + again * (1.0 - mean),
            ]
        })
    }

    /// Reflectance of all further reflections, relative to the light retained by the first one.
    fn again(&self, f0: f64, mean: f64) -> f64 {
        // Mean of Schlick's Fresnel reflectance over directions.
        let fresnel = if f0 > 0.0 { f0 + (1.0 - f0) / 21.0 } else { 0.0 };
        fresnel * fresnel * mean / (1.0 - fresnel * (1.0 - mean))
    }

    /// BRDF times the cosine of incidence; directions have two tangential components and one along the normal.
    pub(crate) fn scattered(&self, light: [f64; 3], view: [f64; 3]) -> [f64; 3] {
        let (i, o) = (light[2], view[2]);
        if i <= 0.0 || o <= 0.0 {
            return [0.0; 3];
        }
        let half = [light[0] + view[0], light[1] + view[1], i + o];
        let norm = (half[0] * half[0] + half[1] * half[1] + half[2] * half[2]).sqrt();
        let dot = (light[0] * half[0] + light[1] * half[1] + i * half[2]) / norm;
        let facets = distribution(half[2] / norm, self.alpha) * both(i, o, self.alpha) / (4.0 * i * o);
        let edge = (1.0 - dot).clamp(0.0, 1.0).powi(5);
        let [[a, b, mean, _], [c, d, _, _]] = [TABLES.at(o, self.alpha), TABLES.at(i, self.alpha)];
        let again = (1.0 - a - b) * (1.0 - c - d) / (PI * (1.0 - mean).max(1e-9));
        let (seen, lit) = (self.glossy(o), self.glossy(i));
        [0, 1, 2].map(|k| {
            let f0 = self.specular[k];
            let glossy = facets * (f0 + b_part(f0, edge) - f0 * edge) + self.again(f0, mean) * again;
            let left = (1.0 - seen[k][0]) * (1.0 - lit[k][0]) / (1.0 - seen[k][1]).max(1e-9);
            (glossy + self.albedo[k] * left / PI) * i
        })
    }

    /// Samples a direction of light from three numbers from 0 to 1: half by the cosine, half by the glossy lobe.
    pub(crate) fn sample(&self, view: [f64; 3], u: [f64; 3]) -> [f64; 3] {
        if u[2] < 0.5 {
            let (radius, phi) = (u[0].sqrt(), 2.0 * PI * u[1]);
            return [radius * phi.cos(), radius * phi.sin(), (1.0 - u[0]).max(0.0).sqrt()];
        }
        let half = visible_normal(view, self.alpha, [u[0], u[1]]);
        let dot: f64 = (0..3).map(|c| view[c] * half[c]).sum();
        [0, 1, 2].map(|c| 2.0 * dot * half[c] - view[c])
    }

    /// Density of [`Self::sample`] per solid angle.
    pub(crate) fn density(&self, light: [f64; 3], view: [f64; 3]) -> f64 {
        if light[2] <= 0.0 {
            return 0.0;
        }
        let half = [0, 1, 2].map(|c| light[c] + view[c]);
        let norm = half.iter().map(|v| v * v).sum::<f64>().sqrt();
        let facets = one(view[2], self.alpha) * distribution(half[2] / norm, self.alpha) / (4.0 * view[2].max(1e-9));
        0.5 * light[2] / PI + 0.5 * facets
    }
}

/// Schlick's rise towards grazing incidence, which is zero for a surface of zero reflectance at normal incidence.
fn b_part(f0: f64, b: f64) -> f64 {
    if f0 > 0.0 { b } else { 0.0 }
}
