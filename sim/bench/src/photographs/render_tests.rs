//! Absolute radiance of the renderer against the simulator, pixel by pixel; they share no formulas.

use super::*;
use nacre_base::progress::Silent;
use nacre_render::{Scene, Settings, render};
use std::path::Path;

const SIDE: usize = 48;

/// A photograph whose orders are several pixels wide, as the simulator samples points and the renderer integrates over
/// pixels.
fn photograph(surface: Surface, coherence_um: f64) -> FlashPhotograph {
    FlashPhotograph {
        surface,
        coherence_um,
        wavelength_nm: 560.0,
        band_nm: 2.0,
        width: SIDE,
        height: SIDE,
        pixel_um: 3200.0,
        flash_diameter_mm: 10.0,
        // Three weights with the variance of a uniform pixel, 1/12.
        blur_px: 0.402,
        baseline_mm: [64.0, 32.0],
        // The centre of the photograph lies below the camera.
        zero_order_px: [10.0, -5.0],
        ..FlashPhotograph::default()
    }
}

/// Rendering of the same scene: radiance per flash intensity.
fn rendered(of: &FlashPhotograph, diffraction: &str) -> Vec<f64> {
    let [bx, by] = of.baseline_mm;
    let fov = 2.0 * (0.5 * SIDE as f64 * of.pixel_um / 1000.0 / of.camera_mm).atan().to_degrees();
    let text = format!(
        "[camera]\nposition = [0, 0, {:?}]\ntarget = [0, 0, 0]\nfov_deg = {fov:?}\nwidth = {SIDE}\nheight = {SIDE}\n[[shape]]\n\
         type = \"plane\"\nsize = [1000, 1000]\nmaterial = \"a\"\n[[light]]\ntype = \"point\"\nposition = [{bx:?}, {by:?}, {:?}]\n\
         sigma_mm = {:?}\nspectrum = {:?}\n[material.a.diffraction]\n{diffraction}\ncoherence_um = {:?}\n",
        of.camera_mm,
        of.flash_mm,
        // Standard deviation of a disc along one axis.
        of.flash_diameter_mm / 4.0,
        of.wavelength_nm,
        // Stam's window has a coherence length of four standard deviations of the field.
        4.0 * of.coherence_um
    );
    let scene: Scene = toml::from_str(&text).unwrap();
    let settings = Settings { samples: 512, max_error: 0.01, ..Settings::default() };
    let (picture, _) = render(&scene, Path::new(""), &settings, &Silent).unwrap();
    let intensity = bx * bx + by * by + of.flash_mm * of.flash_mm;
    picture.pixels.iter().map(|p| p.luminance / intensity).collect()
}

#[test]
fn the_renderer_shows_what_the_simulator_photographs() {
    let grating = |profile, depth_um| Surface::Grating { profile, period_um: 5.0, depth_um, angle_deg: 25.0 };
    let relief = |profile: &str, depth: f64| {
        format!(
            "type = \"grating\"\nperiod_um = 5\norientation_deg = 25\nrelief = {{ profile = {profile}, depth_um = {depth} }}"
        )
    };
    let lattice = Surface::Lattice { pitch_um: [20.0, 30.0], fill: [0.6, 0.8], amplitude: [1.0, 0.0], depth_um: 0.0 };
    // The renderer rescales efficiencies until energy is conserved in every direction. The simulator uses plain scalar
    // theory: it loses evanescent orders, and the phase depth varies between orders. The difference is negligible for
    // a lattice, whose orders lie near the mirror direction. It is 1 % for a sinusoid, 3 % for a rectangular relief
    // with its strong high orders, and 9 % for the weak orders of a blazed grating.
    let cases = [
        (grating(Profile::Sinusoid, 0.15), 6.0, relief("\"sinusoid\"", 0.15), [0.02, 0.012]),
        (grating(Profile::Blazed, 0.2), 6.0, relief("\"blazed\"", 0.2), [0.09, 0.10]),
        (grating(Profile::Rectangular, 0.12), 6.0, relief("{ rectangular = { duty = 0.5 } }", 0.12), [0.04, 0.035]),
        (lattice, 12.0, "type = \"lattice\"\nperiod_um = [20, 30]\naperture_um = [12, 24]".to_owned(), [0.02, 0.003]),
    ];
    // Tolerances: root mean square difference relative to that of the radiances, and relative difference of total
    // light.
    for (surface, coherence, diffraction, [each, all]) in cases {
        let photograph = photograph(surface, coherence);
        let truth = photograph.radiance().unwrap();
        let found = rendered(&photograph, &diffraction);
        let square = |v: &mut dyn Iterator<Item = f64>| v.map(|v| v * v).sum::<f64>();
        let off = square(&mut found.iter().zip(&truth).map(|(f, t)| f - t)) / square(&mut truth.iter().copied());
        let sums = found.iter().sum::<f64>() / truth.iter().sum::<f64>();
        assert!(off.sqrt() < each && (sums - 1.0).abs() < all, "{} {sums}\n{diffraction}", off.sqrt());
    }
}
