//! Pictures of the renderer against photographs of the simulator, which shares none of its formulas: absolute radiance, pixel by pixel.

use super::*;
use nacre_base::progress::Silent;
use nacre_render::{Scene, Settings, render};
use std::path::Path;

const SIDE: usize = 48;

/// A photograph whose orders are several pixels wide, so that it does not matter that it samples places and the renderer covers pixels.
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
        // Three weights whose variance is that of a pixel, 1/12.
        blur_px: 0.402,
        baseline_mm: [64.0, 32.0],
        // The middle of the photograph is below the camera.
        zero_order_px: [10.0, -5.0],
        ..FlashPhotograph::default()
    }
}

/// The same, rendered: radiance per flash intensity.
fn rendered(of: &FlashPhotograph, diffraction: &str) -> Vec<f64> {
    let [bx, by] = of.baseline_mm;
    let fov = 2.0 * (0.5 * SIDE as f64 * of.pixel_um / 1000.0 / of.camera_mm).atan().to_degrees();
    let text = format!(
        "[camera]\nposition = [0, 0, {:?}]\ntarget = [0, 0, 0]\nfov_deg = {fov:?}\nwidth = {SIDE}\nheight = {SIDE}\n[[shape]]\n\
         type = \"plane\"\nsize = [1000, 1000]\nmaterial = \"a\"\n[[light]]\ntype = \"point\"\nposition = [{bx:?}, {by:?}, {:?}]\n\
         sigma_mm = {:?}\nspectrum = {:?}\n[material.a.diffraction]\n{diffraction}\ncoherence_um = {:?}\n",
        of.camera_mm,
        of.flash_mm,
        // A disc's standard deviation along a line.
        of.flash_diameter_mm / 4.0,
        of.wavelength_nm,
        // Four standard deviations of the field are the coherence length of Stam's window.
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
    // The renderer scales powers until no direction gains or loses light; the simulator leaves scalar theory as it is, which has lost what goes
    // below the horizon and sees each order under a depth of its own. That is next to nothing of a lattice's orders, which lie near to the mirror
    // direction, 1 % of a sinusoid, 3 % of a rectangular relief, whose high orders are strong, and 9 % of the weak orders of a blazed one.
    let cases = [
        (grating(Profile::Sinusoid, 0.15), 6.0, relief("\"sinusoid\"", 0.15), [0.02, 0.012]),
        (grating(Profile::Blazed, 0.2), 6.0, relief("\"blazed\"", 0.2), [0.09, 0.10]),
        (grating(Profile::Rectangular, 0.12), 6.0, relief("{ rectangular = { duty = 0.5 } }", 0.12), [0.04, 0.035]),
        (lattice, 12.0, "type = \"lattice\"\nperiod_um = [20, 30]\naperture_um = [12, 24]".to_owned(), [0.02, 0.003]),
    ];
    // Allowed: the root mean square of the differences over that of the radiances, and the difference of all light.
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
