//! Colour differences: CIELAB and CIEDE2000.

/// White point of D65 for the CIE 1931 observer: X, Y, Z with Y = 1.
const WHITE: [f64; 3] = [0.950_47, 1.0, 1.088_83];

/// Converts CIE XYZ (white has Y = 1) to CIELAB (L*, a*, b*) under D65 (CIE 15:2018, 8.2.1).
pub fn lab(xyz: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = [0, 1, 2].map(|k| {
        let t = xyz[k] / WHITE[k];
        if t > (6.0_f64 / 29.0).powi(3) { t.cbrt() } else { t * (29.0_f64 / 6.0).powi(2) / 3.0 + 4.0 / 29.0 }
    });
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// CIEDE2000 difference of two colours in CIELAB (Sharma, Wu and Dalal 2005). A difference of 1 is just noticeable.
pub fn delta_e_2000(one: [f64; 3], other: [f64; 3]) -> f64 {
    let chroma = |c: [f64; 3]| c[1].hypot(c[2]);
    let seventh = |c: f64| (c.powi(7) / (c.powi(7) + 25.0_f64.powi(7))).sqrt();
    let gray = 1.0 + 0.5 * (1.0 - seventh(0.5 * (chroma(one) + chroma(other))));
    let polar = |[_, a, b]: [f64; 3]| {
        let a = gray * a;
        let hue = if a == 0.0 && b == 0.0 { 0.0 } else { b.atan2(a).to_degrees().rem_euclid(360.0) };
        (a.hypot(b), hue)
    };
    let ((c1, h1), (c2, h2)) = (polar(one), polar(other));
    let colourless = c1 * c2 == 0.0;
    let mut turn = if colourless { 0.0 } else { h2 - h1 };
    turn -= if turn.abs() > 180.0 { 360.0_f64.copysign(turn) } else { 0.0 };
    let (light, chroma) = (other[0] - one[0], c2 - c1);
    let hue = 2.0 * (c1 * c2).sqrt() * (0.5 * turn).to_radians().sin();
    let (l, c) = (0.5 * (one[0] + other[0]), 0.5 * (c1 + c2));
    let h = match (h1 + h2, (h1 - h2).abs()) {
        (sum, _) if colourless => sum,
        (sum, apart) if apart <= 180.0 => 0.5 * sum,
        (sum, _) if sum < 360.0 => 0.5 * (sum + 360.0),
        (sum, _) => 0.5 * (sum - 360.0),
    };
    let wave = |factor: f64, shift: f64| (factor * h + shift).to_radians().cos();
    let t = 1.0 - 0.17 * wave(1.0, -30.0) + 0.24 * wave(2.0, 0.0) + 0.32 * wave(3.0, 6.0) - 0.20 * wave(4.0, -63.0);
    let square = (l - 50.0).powi(2);
    let (sl, sc, sh) = (1.0 + 0.015 * square / (20.0 + square).sqrt(), 1.0 + 0.045 * c, 1.0 + 0.015 * c * t);
    let blue = 30.0 * (-((h - 275.0) / 25.0).powi(2)).exp();
    let rotation = -2.0 * seventh(c) * (2.0 * blue).to_radians().sin();
    let (dl, dc, dh) = (light / sl, chroma / sc, hue / sh);
    (dl * dl + dc * dc + dh * dh + rotation * dc * dh).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Test pairs of Sharma, Wu and Dalal (2005), Table 1, chosen to reveal errors of implementation.
    const PAIRS: [([f64; 3], [f64; 3], f64); 16] = [
        ([50.0, 2.6772, -79.7751], [50.0, 0.0, -82.7485], 2.0425),
        ([50.0, 3.1571, -77.2803], [50.0, 0.0, -82.7485], 2.8615),
        ([50.0, -1.3802, -84.2814], [50.0, 0.0, -82.7485], 1.0000),
        ([50.0, 0.0, 0.0], [50.0, -1.0, 2.0], 2.3669),
        ([50.0, 2.49, -0.001], [50.0, -2.49, 0.0009], 7.1792),
        ([50.0, 2.49, -0.001], [50.0, -2.49, 0.0011], 7.2195),
        ([50.0, -0.001, 2.49], [50.0, 0.0009, -2.49], 4.8045),
        ([50.0, -0.001, 2.49], [50.0, 0.0011, -2.49], 4.7461),
        ([50.0, 2.5, 0.0], [73.0, 25.0, -18.0], 27.1492),
        ([50.0, 2.5, 0.0], [56.0, -27.0, -3.0], 31.9030),
        ([50.0, 2.5, 0.0], [50.0, 3.1736, 0.5854], 1.0000),
        ([60.2574, -34.0099, 36.2677], [60.4626, -34.1751, 39.4387], 1.2644),
        ([22.7233, 20.0904, -46.6940], [23.0331, 14.9730, -42.5619], 2.0373),
        ([36.4612, 47.8580, 18.3852], [36.2715, 50.5065, 21.2231], 1.4146),
        ([90.9257, -0.5406, -0.9208], [88.6381, -0.8985, -0.7239], 1.5381),
        ([2.0776, 0.0795, -1.1350], [0.9033, -0.0636, -0.5514], 0.9082),
    ];

    #[test]
    fn published_pairs_are_met() {
        for (one, other, wanted) in PAIRS {
            for found in [delta_e_2000(one, other), delta_e_2000(other, one)] {
                assert!((found - wanted).abs() < 5e-5, "{one:?} {other:?}: {found}, not {wanted}");
            }
        }
    }

    #[test]
    fn white_and_black_are_known() {
        let [l, a, b] = lab(WHITE);
        assert!((l - 100.0).abs() < 1e-9 && a.abs() < 1e-9 && b.abs() < 1e-9);
        assert!(lab([0.0; 3])[0].abs() < 1e-9);
    }
}
