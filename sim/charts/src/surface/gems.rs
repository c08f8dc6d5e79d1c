//! The shader of GPU Gems (2004, chapter 8): colours from a period alone.

/// Orders that it adds up.
const ORDERS: usize = 8;

/// Its wavelengths run from 0.5 to 1 with blue at 0.625, green at 0.75 and red at 0.875; times this they are those of light, in µm.
const MICRON: f64 = 0.72;

/// Linear red, green and blue where the component of `ωi + ωr` across the grooves is `u`: for each order n the bump of the wavelength
/// `period·|u|/n`, all orders alike; it knows neither depth nor shape.
pub(super) fn color(u: f64, period_um: f64) -> [f64; 3] {
    let bump = |x: f64| (1.0 - x * x).max(0.0);
    let mut sum = [0.0; 3];
    for n in 1..=ORDERS {
        let y = 2.0 * period_um * u.abs() / (n as f64 * MICRON) - 1.0;
        for (c, middle) in [0.75, 0.5, 0.25].into_iter().enumerate() {
            sum[c] += bump(4.0 * (y - middle));
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_repeat_at_multiples_and_have_their_colours() {
        // 1.6 µm: 450, 540 and 630 nm of the first order.
        for (nm, c) in [(450.0, 2), (540.0, 1), (630.0, 0)] {
            let rgb = color(nm / 1600.0, 1.6);
            assert!((rgb[c] - 1.0).abs() < 1e-9 && rgb.iter().all(|v| *v <= rgb[c]), "{nm}: {rgb:?}");
        }
        assert_eq!(color(0.0, 1.6), [0.0; 3]);
    }
}
