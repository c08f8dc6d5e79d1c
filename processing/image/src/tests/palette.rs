//! Palettes of angles, judged by CIEDE2000 for normal vision, for dichromats, and in grey.

use nacre_optics::color::{delta_e_2000, lab, xyz_of_linear_srgb};

use crate::palette::cyclic;
use crate::{MASKED, Palette, Rgb};

type Lab = [f64; 3];

/// Linear sRGB as seen by dichromats: G. M. Machado, M. M. Oliveira and L. A. F. Fernandes, "A Physiologically-based
/// Model for Simulation of Color Vision Deficiency" (2009), severity 1.0.
const EYES: [(&str, [[f64; 3]; 3]); 4] = [
    ("usual", [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    (
        "protanopia",
        [[0.152_286, 1.052_583, -0.204_868], [0.114_503, 0.786_281, 0.099_216], [-0.003_882, -0.048_116, 1.051_998]],
    ),
    (
        "deuteranopia",
        [[0.367_322, 0.860_646, -0.227_968], [0.280_085, 0.672_501, 0.047_413], [-0.011_820, 0.042_940, 0.968_881]],
    ),
    (
        "tritanopia",
        [[1.255_528, -0.076_749, -0.178_779], [-0.078_411, 0.930_809, 0.147_602], [0.004_733, 0.691_367, 0.303_900]],
    ),
];

fn lab_of_linear(light: [f64; 3]) -> Lab {
    lab(xyz_of_linear_srgb(light.map(|v| v.clamp(0.0, 1.0) as f32)).map(f64::from))
}

fn seen(color: Rgb, eye: &[[f64; 3]; 3]) -> Lab {
    let decode = |v: u8| {
        let v = f64::from(v) / 255.0;
        if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
    };
    let light = color.map(decode);
    lab_of_linear(eye.map(|row| row.iter().zip(light).map(|(m, v)| m * v).sum()))
}

/// Colours of the angles 0°, 1°, … 179°.
fn degrees(palette: Palette) -> Vec<Rgb> {
    (0..180).map(|deg| palette.color((f64::from(deg)).to_radians() as f32)).collect()
}

/// Smallest difference between colours of angles at least 20° apart.
fn least(palette: Palette, eye: &[[f64; 3]; 3]) -> f64 {
    let colors: Vec<Lab> = degrees(palette).into_iter().map(|color| seen(color, eye)).collect();
    let pairs = (0..180).flat_map(|i| (i + 20..=(i + 160).min(179)).map(move |j| (i, j)));
    pairs.map(|(i, j)| delta_e_2000(colors[i], colors[j])).fold(f64::INFINITY, f64::min)
}

/// Smallest and largest difference between neighbouring degrees, relative to their mean.
fn evenness(colors: &[Lab]) -> [f64; 2] {
    let steps: Vec<f64> = (0..colors.len()).map(|i| delta_e_2000(colors[i], colors[(i + 1) % colors.len()])).collect();
    let mean = steps.iter().sum::<f64>() / steps.len() as f64;
    let (low, high) = steps.iter().fold((f64::MAX, 0.0_f64), |(low, high), s| (low.min(*s), high.max(*s)));
    [low / mean, high / mean]
}

#[test]
fn cyclic_is_closed_even_and_within_srgb() {
    let path: Vec<[f64; 3]> = (0..180).map(|deg| cyclic(f64::from(deg) / 180.0)).collect();
    assert!(path.iter().flatten().all(|v| (0.0..=1.0).contains(v)));
    // The step from 179° to 180° is included, so an open path would be uneven.
    let [low, high] = evenness(&path.iter().map(|light| lab_of_linear(*light)).collect::<Vec<_>>());
    let hues = degrees(Palette::Hsv).into_iter().map(|c| seen(c, &EYES[0].1)).collect::<Vec<_>>();
    let [slow, fast] = evenness(&hues);
    println!("cyclic {low:.3} to {high:.3} of the mean step, hsv {slow:.3} to {fast:.3}");
    assert!(low > 0.9 && high < 1.1, "{low} {high}");
    assert!(slow < 0.3 && fast > 2.0, "{slow} {fast}");
}

#[test]
fn dichromats_tell_angles_of_the_cyclic_palette_apart() {
    for (name, eye) in &EYES {
        let [cyclic, hsv] = [Palette::Cyclic, Palette::Hsv].map(|palette| least(palette, eye));
        println!("{name}: cyclic {cyclic:.1}, hsv {hsv:.1}");
        assert!(cyclic > 13.0, "{name}: {cyclic}");
        assert!(hsv < if *name == "usual" { 6.0 } else { 1.0 }, "{name}: {hsv}");
    }
}

#[test]
fn lightness_orders_the_quadrants_of_the_cyclic_palette() {
    let lightness: Vec<f64> = degrees(Palette::Cyclic).into_iter().map(|c| seen(c, &EYES[0].1)[0]).collect();
    let mean = |k: usize| lightness[45 * k..45 * (k + 1)].iter().sum::<f64>() / 45.0;
    let order = [0, 3, 1, 2].map(mean);
    println!("mean L* of the quadrants from light to dark: {order:.1?}");
    assert!(order.is_sorted_by(|a, b| a - b > 15.0), "{order:?}");
}

#[test]
fn masked_grey_is_off_the_cyclic_palette() {
    for (name, eye) in &EYES {
        let grey = seen(MASKED, eye);
        let nearest = degrees(Palette::Cyclic).into_iter().map(|color| delta_e_2000(seen(color, eye), grey));
        let nearest = nearest.fold(f64::INFINITY, f64::min);
        println!("{name}: {nearest:.1}");
        assert!(nearest > 12.0, "{name}: {nearest}");
    }
}

#[test]
fn corners_of_the_hues() {
    let at = |deg: f32| Palette::Hsv.color(deg.to_radians());
    assert_eq!([at(0.0), at(180.0), at(-180.0)], [[255, 0, 0]; 3]);
    assert_eq!([at(60.0), at(90.0), at(120.0)], [[0, 255, 0], [0, 255, 255], [0, 0, 255]]);
}

#[test]
fn tables_hold_the_colours() {
    for palette in [Palette::Cyclic, Palette::Hsv] {
        let table = palette.table();
        for i in -2000..2000 {
            let theta = i as f32 * 0.0047;
            let (exact, listed) = (palette.color(theta), table.color(theta));
            assert!(exact.iter().zip(listed).all(|(a, b)| a.abs_diff(b) <= 1), "{theta}: {exact:?} {listed:?}");
        }
        assert_eq!([f32::NAN, f32::INFINITY, f32::NEG_INFINITY].map(|v| table.color(v)), [MASKED; 3]);
        assert_eq!(palette.to_string().parse(), Ok(palette));
    }
    assert!("HSV".parse::<Palette>().is_err());
}
