//! The 2018 paper's metals under cellophane (Fig. 14 and 15, and its supplement), by rigorous diffraction.

use super::maps::{normalised, panel, signs, without_mean};
use crate::{Drawn, Picture};
use nacre_base::Result;
use nacre_optics::rcwa::{ALUMINIUM, Grating, ratio};
use nacre_plot::style::SOFT;
use nacre_plot::svg::{Anchor, Area, Axes, Ruler, Svg, fill};
use nacre_polarimetry::synthetic::{Synthetic, even_angles};
use nacre_polarimetry::{Design, Fit};
use num_complex::Complex;
use std::f64::consts::PI;

/// Wavelength in nm and refractive index of cellophane, as in the paper.
const NM: f64 = 560.0;
const CELLOPHANE: f64 = 1.468;

/// Grating of 600 lines per mm and 0.1 µm depth; the paper gives no depth.
const PERIOD_UM: f64 = 1.66;
const DEPTH_UM: f64 = 0.1;

/// Target error of R.
const EXACT: f64 = 1e-4;

/// Refractive indices at 560 nm, interpolated. Aluminium: the paper. Silver, gold and copper: Johnson and Christy 1972.
/// Iron: Johnson and Christy 1974. Brass (70 % copper): Querry 1985. Platinum: Rakić et al. 1998.
const METALS: [(&str, Complex<f64>); 7] = [
    ("aluminium", ALUMINIUM),
    ("silver", Complex::new(0.057, 3.678)),
    ("gold", Complex::new(0.382, 2.594)),
    ("copper", Complex::new(0.911, 2.620)),
    ("brass", Complex::new(0.505, 2.860)),
    ("iron", Complex::new(2.947, 2.950)),
    ("platinum", Complex::new(2.116, 3.760)),
];

/// Retardance of the film in degrees: the paper's bound.
const FILM_DEG: f64 = 10.0;

/// Steps over 180° of both angles.
const STEPS: usize = 90;
const SIDE: f64 = 200.0;
const COLUMNS: usize = 4;

pub(super) fn picture() -> Picture {
    Picture {
        name: "metals",
        group: "polarimetry",
        title: "Metals under cellophane",
        text: "Fig. 14 and 15a of the 2018 paper, and the metals of its supplement. First panel: without a film the intensity of one orientation over the analyser's angle is exactly a \
               sinusoid, whatever r is (the paper reports a fit to 0.002). Maps: intensity over analyser and grating angle, each row normalised, behind a film of 10° with \
               R = r exp(iζ) by rigorous coupled waves of a sinusoid of 1.66 µm, 0.1 µm deep, under cellophane (n 1.468) at 560 nm; left as photographed, right with the mean over \
               all orientations removed first. Red dots mark the maximum of a row, the white line is slope +1. The paper finds a near linear relation for films of up to 10° with \
               its own R, which it does not give; with these, whose ζ is within 2° of 180°, maxima follow the orientation only once the mean is removed.",
        draw,
    }
}

fn draw() -> Result<Drawn> {
    let pitch = [SIDE + 86.0, SIDE + 84.0];
    let panels = 2 + 2 * METALS.len();
    let rows = panels.div_ceil(COLUMNS);
    let mut svg = Svg::new(44.0 + COLUMNS as f64 * pitch[0], 104.0 + rows as f64 * pitch[1] + 20.0);
    svg.text([28.0, 34.0], picture().title, 20.0, Anchor::Start, "font-weight=\"bold\"");
    signs(&mut svg);
    let place = |k: usize| {
        Area::new(84.0 + (k % COLUMNS) as f64 * pitch[0], 104.0 + (k / COLUMNS) as f64 * pitch[1], SIDE, SIDE)
    };
    sinusoids(&mut svg, place(0))?;
    let bare = Synthetic::default();
    panel(&mut svg, place(1), &normalised(&intensities(&bare)), &["no film, r 1.1, ζ 45°".into(), "Fig. 14b".into()])?;
    for (m, (name, below)) in METALS.iter().enumerate() {
        let grating = Grating { period_um: PERIOD_UM, depth_um: DEPTH_UM, above: CELLOPHANE, below: *below };
        let ratio = ratio(&grating, NM, EXACT)?;
        let scene = Synthetic { ratio, retardance: FILM_DEG.to_radians(), ..Synthetic::default() };
        let seen = intensities(&scene);
        let numbers = format!("r {:.3}, ζ {:.1}°", ratio.norm(), ratio.arg().to_degrees());
        let place = |right: usize| place(2 + 2 * m + right);
        panel(&mut svg, place(0), &normalised(&seen), &[format!("{name}, Δn {FILM_DEG}°"), numbers])?;
        let removed = [format!("{name}, Δn {FILM_DEG}°"), "mean over orientations removed".into()];
        panel(&mut svg, place(1), &normalised(&without_mean(&seen)), &removed)?;
    }
    Ok(Drawn::from(svg.finish(picture().title)))
}

/// Intensities: rows are orientations, columns analyser angles.
fn intensities(scene: &Synthetic) -> Vec<Vec<f64>> {
    let angle = |k: usize| PI * k as f64 / STEPS as f64;
    (0..STEPS).map(|t| (0..STEPS).map(|p| scene.intensity(angle(t), angle(p))).collect()).collect()
}

/// Fig. 14a: intensities at twelve angles, and the sinusoid fitted to them.
fn sinusoids(svg: &mut Svg, area: Area) -> Result<()> {
    let x = Ruler::exact(0.0, 180.0, area.x, area.x + area.w);
    let y = Ruler::exact(0.0, 3.5, area.y + area.h, area.y);
    let (x_title, y_title) = ("analyser ψ (°)", "intensity");
    Axes { area, x, y, names: &[], x_title, y_title, percent: false }.draw(svg);
    let mut worst = 0.0_f64;
    for (k, r) in [0.5, 0.75, 1.0, 1.25, 1.5].into_iter().enumerate() {
        let scene = Synthetic { ratio: Complex::from_polar(r, 0.25 * PI), ..Synthetic::default() };
        let angles = even_angles(12);
        let mut fit = Fit::new(1, 1);
        for psi in &angles {
            fit.add(*psi, |_, values, _| values[0] = 2.0 * scene.intensity(0.0, *psi) as f32);
        }
        let maps = fit.solve(&Design::new(&angles)?);
        let [s0, s1, s2] = [maps.s0[0], maps.s1[0], maps.s2[0]].map(f64::from);
        let fitted = |psi: f64| 0.5 * (s0 + s1 * (2.0 * psi).cos() + s2 * (2.0 * psi).sin());
        let curve: Vec<[f64; 2]> =
            (0..=90).map(|d| 2.0 * f64::from(d)).map(|d| [x.at(d), y.at(fitted(d.to_radians()))]).collect();
        let ink = ["#e8a33a", "#dd6f4d", "#bd4576", "#8a2f8f", "#1f1a5c"][k];
        svg.polyline(&curve, &format!("fill=\"none\" stroke=\"{ink}\" stroke-width=\"1.6\""));
        for psi in &angles {
            let light = 2.0 * scene.intensity(0.0, *psi);
            worst = worst.max((light - fitted(*psi)).abs());
            svg.circle([x.at(psi.to_degrees()), y.at(light)], 2.6, &fill(ink));
        }
        let beside = [x.at(128.0), y.at(fitted(128f64.to_radians())) - 5.0];
        svg.text_on_lines(beside, &format!("r {r}"), 11.0, Anchor::Start, &fill(ink));
    }
    svg.text([area.x, area.y - 20.0], "sinusoids, ζ 45°", 12.5, Anchor::Start, "font-weight=\"bold\"");
    let text = if worst < 1e-6 {
        "Fig. 14a: exact (single precision)".into()
    } else {
        format!("Fig. 14a: off by {worst:.1e}")
    };
    svg.text([area.x, area.y - 6.0], &text, 12.0, Anchor::Start, &fill(SOFT));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The specular modulation of every metal is weak (r near 1), and all metals are drawn. Without a film the sinusoid
    /// is exact.
    #[test]
    fn every_metal_is_drawn() {
        for (name, below) in METALS {
            let grating = Grating { period_um: PERIOD_UM, depth_um: DEPTH_UM, above: CELLOPHANE, below };
            let ratio = ratio(&grating, NM, EXACT).unwrap();
            assert!((0.5..2.0).contains(&ratio.norm()), "{name} {ratio}");
        }
        let svg = draw().unwrap().svg;
        assert!(METALS.iter().all(|(name, _)| svg.contains(&format!("{name}, Δn 10°"))) && svg.contains("exact"));
    }
}
