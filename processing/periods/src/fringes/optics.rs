//! Exact geometry of camera, sample and panel: panel positions where diffraction orders land.

use std::f64::consts::TAU;

/// Positions in sample coordinates: mm, origin in the centre of the sample, x right and y up as seen by the camera, z
/// along the outward normal.
#[derive(Clone, Debug)]
pub struct Optics {
    /// Centre of the camera's entrance pupil.
    pub viewer_mm: [f64; 3],
    /// Columns: x, y and normal of the panel (towards the sample) in sample coordinates.
    pub panel_axes: [[f64; 3]; 3],
    /// Centre of the panel.
    pub panel_mm: [f64; 3],
    /// Width and height of the panel in mm.
    pub panel_size_mm: [f64; 2],
    /// Effective wavelength in µm.
    pub wavelength_um: f64,
    /// Relative standard deviation of the spectral band.
    pub band: f64,
    /// Diameter of the camera's aperture in mm.
    pub aperture_mm: f64,
}

/// Position of a pixel on the sample, and its mirror direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Point on the sample in mm.
    pub point: [f64; 3],
    /// Sines of the mirror direction: the negative tangential part of the direction to the camera.
    pub mirror: [f64; 2],
    /// Standard deviation of the sines over the aperture: half its radius over the distance.
    pub spread: f64,
}

/// Intersection of a direction with the panel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Landing {
    /// Position in mm, to the right of and above the panel's centre.
    pub at: [f64; 2],
    /// Derivative in mm per sine: `[[dx/du, dx/dv], [dy/du, dy/dv]]`.
    pub slope: [[f64; 2]; 2],
}

impl Optics {
    /// Pixel that sees this point of the sample.
    pub fn place(&self, point: [f64; 3]) -> Place {
        let to: [f64; 3] = std::array::from_fn(|i| self.viewer_mm[i] - point[i]);
        let distance = norm(to);
        Place { point, mirror: [-to[0] / distance, -to[1] / distance], spread: 0.25 * self.aperture_mm / distance }
    }

    /// Intersection of a direction with these sines, away from the surface, with the panel's plane. `None` for
    /// evanescent directions, and for those that do not approach the panel's front.
    pub fn land(&self, point: [f64; 3], [u, v]: [f64; 2]) -> Option<Landing> {
        let rest = 1.0 - u * u - v * v;
        if rest < 0.01 {
            return None;
        }
        let w = rest.sqrt();
        let [ex, ey, ez] = self.panel_axes;
        let from: [f64; 3] = std::array::from_fn(|i| point[i] - self.panel_mm[i]);
        let along = [u, v, w];
        let speed = dot(ez, along);
        if speed.abs() < 0.05 {
            return None;
        }
        let reach = -dot(ez, from) / speed;
        if reach <= 0.0 {
            return None;
        }
        let at = [dot(ex, from) + reach * dot(ex, along), dot(ey, from) + reach * dot(ey, along)];
        // The direction depends on its sines, and so does the distance to the plane.
        let moved = |change: [f64; 3]| {
            let dreach = -reach * dot(ez, change) / speed;
            [reach * dot(ex, change) + dreach * dot(ex, along), reach * dot(ey, change) + dreach * dot(ey, along)]
        };
        let (du, dv) = (moved([1.0, 0.0, -u / w]), moved([0.0, 1.0, -v / w]));
        Some(Landing { at, slope: [[du[0], dv[0]], [du[1], dv[1]]] })
    }

    /// True if a position is on the panel, at least `margin` mm from its edge.
    pub fn is_on(&self, at: [f64; 2], margin: f64) -> bool {
        (0..2).all(|i| at[i].abs() <= 0.5 * self.panel_size_mm[i] - margin)
    }

    /// Sines of the direction from a point of the sample to a panel position.
    pub fn towards(&self, point: [f64; 3], at: [f64; 2]) -> [f64; 2] {
        let [ex, ey, _] = self.panel_axes;
        let to: [f64; 3] = std::array::from_fn(|i| self.panel_mm[i] + at[0] * ex[i] + at[1] * ey[i] - point[i]);
        let distance = norm(to);
        [to[0] / distance, to[1] / distance]
    }

    /// Remaining modulation of a fringe in order `m`: aperture and spectral band blur it over the panel.
    pub fn modulation(&self, carrier: [f64; 2], landing: &Landing, place: &Place, order: f64, q: [f64; 2]) -> f64 {
        let [[a, b], [c, d]] = landing.slope;
        // Phase per sine.
        let phase = [carrier[0] * a + carrier[1] * c, carrier[0] * b + carrier[1] * d];
        let band = self.band * order * (phase[0] * q[0] + phase[1] * q[1]);
        // Sines vary with the aperture across the line of sight, and by the squared cosine along it.
        let [u, v] = place.mirror;
        let along = u * phase[0] + v * phase[1];
        let seen = [phase[0] - u * along, phase[1] - v * along];
        // Transfer function 2 J1(x)/x of a disc with radius 2·spread, accurate to fourth order in the exponent.
        let x2 = 4.0 * place.spread * place.spread * (seen[0] * seen[0] + seen[1] * seen[1]);
        (-x2 / 8.0 - x2 * x2 / 384.0 - 0.5 * band * band).exp()
    }
}

/// Angular frequency in rad/mm from cycles per mm.
pub fn carrier(cycles_per_mm: [f64; 2]) -> [f64; 2] {
    cycles_per_mm.map(|f| TAU * f)
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn norm(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Panel and camera side by side above the sample.
    pub(crate) fn facing() -> Optics {
        Optics {
            viewer_mm: [-50.0, 0.0, 250.0],
            panel_axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            panel_mm: [50.0, 0.0, 250.0],
            panel_size_mm: [520.0, 320.0],
            wavelength_um: 0.56,
            band: 0.0,
            aperture_mm: 12.0,
        }
    }

    /// The mirror point of the sample's centre is the panel's centre; for a mirror direction along the normal, 1.66 µm
    /// at 530 nm diffracts to 18.6°.
    #[test]
    fn orders_land_where_the_grating_equation_says() {
        let optics = facing();
        let place = optics.place([0.0; 3]);
        let landing = optics.land(place.point, place.mirror).unwrap();
        assert!(landing.at.iter().all(|c| c.abs() < 1e-9), "{landing:?}");
        let overhead = Optics { viewer_mm: [0.0, 0.0, 250.0], panel_mm: [0.0, 0.0, 250.0], ..facing() };
        let sine = 0.530 / 1.66;
        let off = overhead.land([0.0; 3], [sine, 0.0]).unwrap().at;
        assert!((off[0] - 250.0 * sine.asin().tan()).abs() < 1e-9 && (sine.asin().to_degrees() - 18.6).abs() < 0.05);
    }

    #[test]
    fn slopes_and_directions_agree_with_differences() {
        let (c, s) = (0.3_f64.cos(), 0.3_f64.sin());
        let optics = Optics { panel_axes: [[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]], ..facing() };
        let (point, sines) = ([3.0, -7.0, 0.0], [0.31, -0.2]);
        let landing = optics.land(point, sines).unwrap();
        let back = optics.towards(point, landing.at);
        assert!((back[0] - sines[0]).abs() < 1e-12 && (back[1] - sines[1]).abs() < 1e-12);
        for axis in 0..2 {
            let mut near = sines;
            near[axis] += 1e-6;
            let moved = optics.land(point, near).unwrap().at;
            for (moved, (at, slope)) in moved.iter().zip(landing.at.iter().zip(&landing.slope)) {
                assert!(((moved - at) / 1e-6 - slope[axis]).abs() < 1e-2);
            }
        }
    }

    /// Blur by the aperture, compared with a numerical integral.
    #[test]
    fn the_aperture_takes_modulation_away() {
        let optics = facing();
        let place = optics.place([2.0, 3.0, 0.0]);
        let (q, k) = ([0.2, 0.1], carrier([0.03, 0.01]));
        let landing = optics.land(place.point, [place.mirror[0] + q[0], place.mirror[1] + q[1]]).unwrap();
        let (mut sum, mut count) = ([0.0; 2], 0.0);
        for i in 0..60 {
            for j in 0..60 {
                let [a, b] = [i, j].map(|n| (f64::from(n) + 0.5) / 30.0 - 1.0);
                if a * a + b * b > 1.0 {
                    continue;
                }
                let moved = Optics { viewer_mm: [-50.0 + 6.0 * a, 6.0 * b, 250.0], ..facing() };
                let mirror = moved.place(place.point).mirror;
                let at = optics.land(place.point, [mirror[0] + q[0], mirror[1] + q[1]]).unwrap().at;
                let phase = k[0] * at[0] + k[1] * at[1];
                sum = [sum[0] + phase.cos(), sum[1] + phase.sin()];
                count += 1.0;
            }
        }
        let exact = sum[0].hypot(sum[1]) / count;
        let got = optics.modulation(k, &landing, &place, 1.0, q);
        assert!((got - exact).abs() < 0.01, "{got} {exact}");
    }
}
