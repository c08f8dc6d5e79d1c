//! Tests of energy conservation and reciprocity.

use super::*;

#[test]
fn nothing_gains_light_and_lossless_surfaces_lose_none() {
    let dir = tempfile::tempdir().unwrap();
    let base = |albedo: f64, roughness: f64, specular: f64| {
        format!(
            "[material.a.base]\nalbedo = [{albedo}, {albedo}, {albedo}]\nroughness = {roughness}\nspecular = [{specular}, {specular}, {specular}]\n"
        )
    };
    let top = |text: &str| format!("[material.a.diffraction]\n{text}\n");
    // Material, reflected share, samples.
    let cases = [
        (base(1.0, 0.3, 0.04), 1.0, 8192),
        (base(1.0, 0.9, 0.5), 1.0, 8192),
        (base(0.0, 0.1, 1.0), 1.0, 8192),
        (base(0.0, 0.6, 1.0), 1.0, 8192),
        (base(0.0, 1.0, 1.0), 1.0, 8192),
        (top("type = \"grating\"\nperiod_um = 1.6\norientation_deg = 20\nrelief = { depth_um = 0.2 }"), 1.0, 64),
        (top("type = \"grating\"\nperiod_um = 0.9\norientation_deg = 90\nrelief = { depth_um = 1.1 }"), 1.0, 64),
        (
            top(
                "type = \"grating\"\nperiod_um = 2.5\norientation_deg = 0\nrelief = { profile = \"blazed\", depth_um = 0.3 }",
            ),
            1.0,
            64,
        ),
        (top("type = \"cd\"\nrelief = { profile = { rectangular = { duty = 0.4 } }, depth_um = 0.12 }"), 1.0, 64),
        (top("type = \"multislit\""), 0.25, 64),
        (top("type = \"multislit\"\nradial = true"), 0.25, 64),
        (top("type = \"lattice\"\nperiod_um = [60, 80]\naperture_um = [20, 60]"), 0.25, 64),
    ];
    for (material, wanted, samples) in cases {
        for (angle, azimuth) in [(0.0, 0.0), (40.0, 0.0), (65.0, 70.0)] {
            let text = plane(angle, azimuth, &format!("{material}{SKY}"));
            let found = mean(&picture(&text, dir.path(), &settings(samples, 1e-4)));
            for v in found {
                assert!((v / wanted - 1.0).abs() < 0.005, "{angle} {azimuth}: {found:?}\n{material}");
            }
        }
    }
}

#[test]
fn tables_conserve_energy() {
    let dir = tempfile::tempdir().unwrap();
    table(dir.path());
    let base = |albedo: f64, roughness: f64, specular: f64| {
        format!(
            "[material.a.base]\nalbedo = [{albedo}, {albedo}, {albedo}]\nroughness = {roughness}\nspecular = [{specular}, {specular}, {specular}]\n"
        )
    };
    let top = |text: &str| format!("[material.a.diffraction]\n{text}\n");
    // Grazing light is sampled rarely with large weights: fewer samples leave an error of 0.6 %.
    lossless_is_white(dir.path(), &top("type = \"table\"\nfile = \"lut.exr\"\nlossless = true"), 65_536, 0.005);
    // Without `lossless` they lose some light at most.
    for material in [
        top("type = \"table\"\nfile = \"lut.exr\""),
        format!(
            "{}{}",
            base(1.0, 0.3, 0.5),
            top(
                "type = \"grating\"\nperiod_um = 1.6\norientation_deg = 20\nrelief = { depth_um = 0.2 }\nreflectance = \"aluminium\""
            )
        ),
        format!(
            "[material.a]\nblend = \"fresnel\"\n{}{}",
            base(1.0, 0.3, 0.5),
            top(
                "type = \"grating\"\nperiod_um = 1.6\norientation_deg = 20\nrelief = { depth_um = 0.2 }\nreflectance = \"schlick=0.3\""
            )
        ),
    ] {
        for angle in [0.0, 50.0, 75.0] {
            let found =
                mean(&picture(&plane(angle, 10.0, &format!("{material}{SKY}")), dir.path(), &settings(4096, 1e-4)));
            assert!(found.iter().all(|v| (0.2..1.005).contains(v)), "{angle}: {found:?}\n{material}");
        }
    }
}

fn luminance([r, g, b]: [f64; 3]) -> f64 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// A lossless material reproduces a white sky: its luminance to 0.5 %, its colours to `allowed`.
fn lossless_is_white(dir: &Path, material: &str, samples: usize, allowed: f64) {
    for (angle, azimuth) in [(0.0, 0.0), (40.0, 0.0), (65.0, 70.0)] {
        let text = plane(angle, azimuth, &format!("{material}{SKY}"));
        // By Monte Carlo sampling: a precomputed table would be divided by the same sum.
        let found = mean(&picture(&text, dir, &Settings { method: Method::Samples, ..settings(samples, 1e-4) }));
        let white = luminance(found);
        assert!((white - 1.0).abs() < 0.005, "{angle} {azimuth}: {white} {found:?}\n{material}");
        assert!(found.iter().all(|v| (v - 1.0).abs() < allowed), "{angle} {azimuth}: {found:?}\n{material}");
    }
}

#[test]
fn height_fields_conserve_energy() {
    let dir = tempfile::tempdir().unwrap();
    heights(dir.path());
    let material = "[material.a.diffraction]\ntype = \"heightfield\"\nfile = \"heights.exr\"\nlossless = true\n";
    // Colours have three times the noise of luminance.
    lossless_is_white(dir.path(), material, 8192, 0.015);
    // Luminance, with noise of 0.5 %.
    let text = plane(88.0, 10.0, &format!("{material}{SKY}"));
    let found = mean(&picture(&text, dir.path(), &settings(16_384, 1e-4)));
    assert!((luminance(found) - 1.0).abs() < 0.015, "{found:?}");
    let material = material.replace("lossless = true\n", "");
    let text = plane(75.0, 10.0, &format!("{material}{SKY}"));
    let found = mean(&picture(&text, dir.path(), &settings(4096, 1e-4)));
    assert!((0.2..1.005).contains(&luminance(found)), "{found:?}");
    assert!(found.iter().all(|v| (0.2..1.015).contains(v)), "{found:?}");
}

#[test]
fn balanced_orders_are_reciprocal_and_near_to_scalar_theory() {
    let mut scratch = Scratch::default();
    let groove = Groove { across: [0.8, 0.6], period_um: 1.7 };
    let direction = |x: f64, y: f64| [x, y, (1.0 - x * x - y * y).sqrt()];
    let profiles = [
        (Profile::Blazed, 0.25),
        (Profile::Sinusoid, 0.1),
        (Profile::Sinusoid, 1.1),
        (Profile::Rectangular { duty: 0.3 }, 0.2),
    ];
    for (profile, depth_um) in profiles {
        let section = Section::Formula { profile, depth_um };
        let grating = Grating::new(&section, 1.7, 0.01, Reflectance::Perfect, 1e-9);
        for view in [direction(0.1, 0.05), direction(-0.6, 0.3), direction(0.2, -0.9)] {
            let mut orders = vec![];
            grating.orders(view, groove, 1.9, &mut scratch, |o| orders.push(o));
            let sum: f64 = orders.iter().map(|o| o.power).sum();
            assert!((sum - 1.0).abs() < 1e-3, "{section:?} {view:?}: {sum}");
            for order in &orders {
                // The grating equation.
                let step = f64::from(order.order) / (1.9 * 1.7);
                let pairs = order.from.iter().zip(&view).zip(&groove.across);
                for ((from, to), across) in pairs {
                    assert!((from + to - step * across).abs() < 1e-12);
                }
                let mut back = vec![];
                grating.orders(order.from, groove, 1.9, &mut scratch, |o| back.push(o));
                let same = back.iter().find(|o| o.order == order.order).unwrap();
                assert!((same.power - order.power).abs() < 2e-3, "{section:?} {order:?} {same:?}");
            }
        }
    }
    // Light along the normal of a shallow grating: all orders with significant power propagate, and w is nearly the
    // same for all.
    let shallow = Section::Formula { profile: Profile::Sinusoid, depth_um: 0.03 };
    let grating = Grating::new(&shallow, 8.0, 0.01, Reflectance::Perfect, 1e-9);
    let groove = Groove { across: [1.0, 0.0], period_um: 8.0 };
    grating.orders([0.0, 0.0, 1.0], groove, 1.9, &mut scratch, |o| {
        let theory = libm::jn(o.order.abs(), TAU * 1.9 * 2.0 * 0.015).powi(2);
        if o.order.abs() <= 1 {
            assert!((o.power / theory - 1.0).abs() < 0.02, "{o:?} {theory}");
        }
    });
}

#[test]
fn steep_grooves_are_reported() {
    let notes = |relief: &str| {
        let text = format!(
            "[material.a.diffraction]\ntype = \"grating\"\nperiod_um = 1.6\norientation_deg = 0\nrelief = {{ {relief} }}\n{SKY}"
        );
        let scene = Scene::parse(&plane(0.0, 0.0, &text)).unwrap();
        PreparedScene::new(&scene, Path::new(""), Accuracy::new(0.01, None), &Silent).unwrap().notes["a"].clone()
    };
    // 0.3 ⟨h'²⟩ / cos 45° of a sinusoid.
    let shallow = notes("depth_um = 0.1");
    let wanted = 0.3 * 0.5 * (std::f64::consts::PI * 0.1 / 1.6).powi(2) * 2.0_f64.sqrt();
    assert!((shallow.theory_error.unwrap() / wanted - 1.0).abs() < 0.02 && shallow.warnings.is_empty(), "{shallow:?}");
    let steep = notes("depth_um = 0.4, profile = \"blazed\"");
    assert!(steep.theory_error.unwrap() > 0.1 && steep.warnings.iter().any(|w| w.contains("steep")), "{steep:?}");
}
