//! Picture of a check by the grating equation: measured and expected peaks.

use crate::GratingCheck;
use nacre_plot::Scale;
use nacre_plot::style::{INK, SOFT};
use nacre_plot::svg::{Anchor, Area, Axes, Ruler, Svg, fill};

const DOT: &str = "fill=\"#0072b2\"";
const TRUTH: &str = "fill=\"none\" stroke=\"#d55e00\" stroke-width=\"1.6\"";

/// SVG of 1000 × 420 units of the peaks of a [`GratingCheck`] (2014 thesis, section 5.3).
///
/// On the left, angles in degrees over the wavelength in nm, with the line `sin θr = λ/a - sin θi` for the expected
/// period a. On the right, the periods in nm from the grating equation.
pub fn peaks_picture(check: &GratingCheck) -> String {
    let mut svg = Svg::new(1000.0, 420.0);
    let peaks = &check.peaks;
    let wavelengths = || peaks.iter().map(|p| p.wavelength_nm);
    // Every peak gives the sine of the light's angle; all agree by definition of the periods.
    let light = peaks.first().map_or(0.0, |p| p.wavelength_nm / p.period_nm - p.theta_r_deg.to_radians().sin());
    let truth = |nm: f64| (nm / check.expected_nm - light).asin().to_degrees();
    let low = wavelengths().fold(f64::INFINITY, f64::min);
    let high = wavelengths().fold(f64::NEG_INFINITY, f64::max);
    let line: Vec<f64> = (0..=100).map(|k| low + (high - low) * f64::from(k) / 100.0).collect();

    let area = Area::new(80.0, 50.0, 390.0, 300.0);
    let x = Ruler::covering(Scale::Linear, wavelengths(), area.x, area.x + area.w);
    let angles = peaks.iter().map(|p| p.theta_r_deg).chain(line.iter().map(|nm| truth(*nm)));
    let y = Ruler::covering(Scale::Linear, angles, area.y + area.h, area.y);
    let y_title = "angle of the peak (°)";
    Axes { area, x, y, names: &[], x_title: "wavelength (nm)", y_title, percent: false }.draw(&mut svg);
    let along: Vec<[f64; 2]> =
        line.iter().filter(|nm| truth(**nm).is_finite()).map(|nm| [x.at(*nm), y.at(truth(*nm))]).collect();
    svg.polyline(&along, TRUTH);
    peaks.iter().for_each(|p| svg.circle([x.at(p.wavelength_nm), y.at(p.theta_r_deg)], 2.6, DOT));

    let area = Area::new(580.0, 50.0, 390.0, 300.0);
    let x = Ruler::covering(Scale::Linear, wavelengths(), area.x, area.x + area.w);
    // A margin of at least 0.1 %, so that rounding errors do not fill the picture.
    let around = [0.999, 1.001].map(|part| part * check.expected_nm);
    let periods = peaks.iter().map(|p| p.period_nm).chain(around);
    let y = Ruler::covering(Scale::Linear, periods, area.y + area.h, area.y);
    let y_title = "period by the grating equation (nm)";
    Axes { area, x, y, names: &[], x_title: "wavelength (nm)", y_title, percent: false }.draw(&mut svg);
    svg.polyline(&[low, high].map(|nm| [x.at(nm), y.at(check.expected_nm)]), TRUTH);
    peaks.iter().for_each(|p| svg.circle([x.at(p.wavelength_nm), y.at(p.period_nm)], 2.6, DOT));

    let text = format!(
        "mean {:.2} nm, variance {:.3} nm², expected {:.2} nm",
        check.mean_nm, check.variance_nm2, check.expected_nm
    );
    svg.text([80.0, 28.0], "Peaks of the first order and the grating equation", 16.0, Anchor::Start, &fill(INK));
    svg.text([970.0, 28.0], &text, 13.0, Anchor::End, &fill(SOFT));
    svg.finish("Peaks of the first order and the grating equation")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::height::{Profile, Quality, Shape, Synthetic};
    use crate::{Settings, check};
    use nacre_base::progress::Silent;
    use nacre_plot::png_from_svg;

    #[test]
    fn peaks_lie_on_the_line_of_the_equation() {
        let shape = Shape::Grating(Profile::Blazed);
        let field = Synthetic { shape, pixels: 100, pixel_um: 0.075, period_um: 2.5, depth_um: 0.3, angle: 0.0 };
        let field = field.field().unwrap();
        let quality = Quality::of(&field, 65.0);
        let settings = Settings { light_deg: [75.0, 0.0], ..Settings::default() };
        let found =
            check(&field, &quality, &settings, &[400.0, 500.0, 600.0], [Some(2.5), Some(0.0)], &Silent).unwrap();
        let svg = peaks_picture(&found);
        assert!(png_from_svg(&svg, 1.0).is_ok());
        // Each dot of the left panel is at the height of the line at its wavelength, within one unit.
        let numbers = |text: &str| -> Vec<f64> {
            text.split(|c: char| !(c.is_ascii_digit() || c == '.')).filter_map(|n| n.parse().ok()).collect()
        };
        let lines: Vec<Vec<f64>> = svg.lines().filter(|l| l.starts_with("<polyline")).map(numbers).collect();
        let dots: Vec<Vec<f64>> = svg.lines().filter(|l| l.starts_with("<circle")).map(numbers).collect();
        assert_eq!((lines.len(), dots.len()), (2, 6));
        for dot in &dots[..3] {
            let near = lines[0].chunks_exact(2).min_by(|a, b| (a[0] - dot[0]).abs().total_cmp(&(b[0] - dot[0]).abs()));
            assert!((near.unwrap()[1] - dot[1]).abs() < 3.0, "{dot:?} {near:?}");
        }
    }

    #[test]
    fn a_check_without_peaks_is_a_picture_too() {
        let shape = Shape::Grating(Profile::Sinusoid);
        let field = Synthetic { shape, pixels: 64, pixel_um: 0.1, period_um: 1.6, depth_um: 0.1, angle: 0.0 };
        let field = field.field().unwrap();
        let (quality, settings) = (Quality::of(&field, 65.0), Settings::default());
        let found = check(&field, &quality, &settings, &[500.0], [Some(1.6), Some(0.0)], &Silent).unwrap();
        let none = GratingCheck { peaks: vec![], ..found };
        assert!(png_from_svg(&peaks_picture(&none), 1.0).is_ok());
    }
}
