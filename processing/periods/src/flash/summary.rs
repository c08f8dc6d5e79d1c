//! Contents of the report: common uncertainty, assumptions and warnings.

use super::fit::{Found, MaskReason};
use super::reconstruct::{Fitted, Job};
use super::report::{Masked, PeriodReport, Registration, Report, Seconds};
use super::settings::{Directions, Orientation, Settings};
use super::view::half;

/// Relative systematic error of all periods from non-Gaussian lobes.
const LOBE: f64 = 0.003;

impl Job {
    /// Relative change of a half vector of this length per mm of light height and of camera height, averaged over the
    /// sheet.
    fn per_mm(&self, length: f64) -> [f64; 2] {
        let mut sums = [0.0; 3];
        let [x, y, z] = self.view.viewer;
        for light in &self.lights {
            for tile in 0..self.tiling.origins.len() {
                let place = self.tiling.place(tile, self.tiling.width / 2, self.tiling.height / 2);
                let size = |v: [f64; 2]| v[0].hypot(v[1]);
                let now = size(self.view.half(place, *light).half);
                let weight = (-0.5 * ((now - length) / (0.2 * length)).powi(2)).exp();
                let raised = [light[0], light[1], light[2] + 1.0];
                sums[0] += weight;
                sums[1] += weight * (size(self.view.half(place, raised).half) / now - 1.0);
                sums[2] += weight * (size(half([x, y, z + 1.0], place, *light).half) / now - 1.0);
            }
        }
        [sums[1] / sums[0].max(1e-9), sums[2] / sums[0].max(1e-9)]
    }

    /// Report without computation times.
    pub fn report(&self, fit: &Fitted, settings: &Settings) -> Report {
        let Fitted { found, period, directions, lobe, prior } = fit;
        let um = self.wavelength_nm / 1000.0;
        let median = |mut values: Vec<f64>, share: usize| {
            values.sort_by(f64::total_cmp);
            values.get(values.len().saturating_sub(1) * share / 100).copied()
        };
        let gratings = || found.iter().filter_map(|f| if let Found::Grating(g) = f { Some(g) } else { None });
        let lengths: Vec<f64> = gratings().map(|g| g.length).collect();
        let typical = median(lengths.clone(), 50).unwrap_or(prior.range[0]);
        let [light_per_mm, camera_per_mm] = self.per_mm(typical);
        let sigma = &self.geometry_sigma;
        let of_wavelength = sigma.wavelength_nm.unwrap_or(0.0) / self.wavelength_nm;
        let of_light = sigma.light_mm.map_or(0.0, |s| s[2] * light_per_mm);
        let of_camera = sigma.sample_mm.map_or(0.0, |s| s[2] * camera_per_mm);
        let common_sigma = of_wavelength.hypot(of_light).hypot(of_camera).hypot(LOBE);
        let middle = self.tiling.place(0, self.tiling.width / 2, self.tiling.height / 2);
        let seen = self.view.half(middle, self.lights[0]);
        let shared_um = prior.shared.map(|[length, _]| um / length);
        let period = PeriodReport {
            um: shared_um,
            sigma_um: prior.shared.zip(shared_um).map(|([l, s], um)| um * (s / l).hypot(common_sigma)),
            median_um: median(lengths.clone(), 50).map(|l| um / l),
            range_um: median(lengths.clone(), 95).zip(median(lengths, 5)).map(|(a, b)| [um / a, um / b]),
            ..period.clone()
        };
        let mut report = Report {
            method: "flash",
            warnings: vec![],
            assumptions: vec![],
            palette: settings.palette,
            width: self.tiling.width,
            height: self.tiling.height,
            pixel_um: 1000.0 * self.tiling.pitch_mm,
            tiles: self.tiling.origins.len(),
            reference_mm: self.tiling.origins[0],
            registration: self.moved.map(|m| Registration {
                most_px: m.most_px,
                sigma_px: m.sigma_px,
                left_out: m.left_out,
            }),
            lights_mm: self.lights.clone(),
            highlights: self.highlights.iter().map(|h| h.map(|h| h.half)).collect(),
            light_sigma_mm: lobe.light_mm,
            lobe: lobe.at(&seen).width(),
            spacing: self.spacing(middle),
            wavelength_nm: self.wavelength_nm,
            searched_um: [um / prior.range[1], um / prior.range[0]],
            relative: self.view.relative.is_some(),
            orientation: settings.orientation,
            directions: directions.clone(),
            period,
            sigma_deg: median(gratings().map(|g| g.orientation_sigma.to_degrees()).collect(), 50),
            period_sigma: median(gratings().map(|g| (g.length_sigma / g.length).hypot(common_sigma)).collect(), 50),
            common_sigma,
            masked: masked(found),
            seconds: Seconds::default(),
        };
        report.assumptions = self.assumptions(settings, [light_per_mm, camera_per_mm]);
        if directions.choice == Directions::Shared {
            report.assumptions.push(
                "polygons have one of the shared gratings, and first orders of about the same light; areas that tell otherwise are masked"
                    .into(),
            );
        }
        report.warnings = self.warnings(&report, settings);
        report
    }

    /// Typical distance between half vectors of a position's copies, with both signs folded.
    pub fn spacing(&self, at: [f64; 2]) -> f64 {
        let [width, height] = [self.tiling.width, self.tiling.height].map(|n| n as f64 * self.tiling.pitch_mm);
        let half = |dx: f64, dy: f64| self.view.half([at[0] + dx, at[1] + dy], self.lights[0]).half;
        let (o, x, y) = (half(0.0, 0.0), half(1.0, 0.0), half(0.0, 1.0));
        let area = ((x[0] - o[0]) * (y[1] - o[1]) - (x[1] - o[1]) * (y[0] - o[0])).abs();
        (area * width * height / (2 * self.lights.len()) as f64).sqrt()
    }

    fn assumptions(&self, settings: &Settings, [light, camera]: [f64; 2]) -> Vec<String> {
        let mut all = vec![
            format!(
                "the wavelength is right: 1 nm is {:.2} % of the period",
                100.0 / self.wavelength_nm
            ),
            format!(
                "heights of light and camera are right: 1 mm of the light's is {:.2} % of the period, 1 mm of the camera's {:.2} %",
                100.0 * light.abs(),
                100.0 * camera.abs()
            ),
            "the sheet is flat, and each place has one grating; first orders are at least half as bright as higher ones, as of grooves \
             less than about a quarter of a wavelength deep"
                .into(),
        ];
        if settings.period_um.is_some() {
            all.push("all periods lie in the range that was given".into());
        }
        if !self.noise_known {
            all.push("the camera's noise is not known; a modest one was assumed".into());
        }
        if self.corners_found {
            all.push("the brightest area of the photograph by room light is the sheet".into());
        }
        if let Some(why) = &self.view.relative {
            all.push(why.clone());
        }
        all
    }

    fn warnings(&self, report: &Report, settings: &Settings) -> Vec<String> {
        let mut all = vec![];
        if report.relative {
            all.push("periods are relative: right up to a common factor only (no calibrated geometry)".into());
        }
        let tiles = report.tiles > 1;
        match &report.registration {
            None if tiles => all.push(
                "tiles were taken to lie on an exact grid, since no photograph by room light shows where they do; orientations near edges may \
                 be of the polygon next to them"
                    .into(),
            ),
            Some(r) if r.left_out > 0 => {
                all.push(format!("{} tiles look like no other and were left out", r.left_out));
            }
            _ => {}
        }
        if self.corrected > 0 {
            all.push(format!(
                "highlights lie elsewhere than {} of {} lights would have them; the lights were moved to where they say",
                self.corrected,
                self.lights.len()
            ));
        }
        let missing = report.highlights.iter().filter(|h| h.is_none()).count();
        if missing > 0 {
            all.push(format!(
                "{missing} of the highlights are not in the picture, so nothing checks where those lights were"
            ));
        }
        if settings.orientation == Orientation::Half && report.spacing > 2.2 * report.lobe {
            let lights = (self.lights.len() as f64 * (report.spacing / (2.0 * report.lobe)).powi(2)).ceil();
            all.push(format!(
                "copies of a place are seen under half vectors {:.3} apart, but lobes have a σ of {:.3}: many places are lit by chance; about \
                 {lights:.0} lights would do",
                report.spacing, report.lobe
            ));
        }
        if settings.orientation == Orientation::Image {
            all.push(
                "orientations and periods are those of the brightest copies, which are biased; half does better".into(),
            );
        }
        if report.sigma_deg.is_none() {
            all.push(
                "no pixel has a grating that is known (see masked): periods may lie outside of the range that was looked at (--period-um), or \
                 places have several gratings"
                    .into(),
            );
        }
        if report.masked.ambiguous > 0.02 {
            all.push(format!(
                "{:.0} % of the pixels have light that several gratings or orders explain; more lights, or a range of periods, tell them \
                 apart",
                100.0 * report.masked.ambiguous
            ));
        }
        all
    }
}

fn masked(found: &[Found]) -> Masked {
    let share = |why: MaskReason| {
        let count = found.iter().filter(|f| matches!(f, Found::Masked(w) if *w == why)).count();
        count as f64 / found.len().max(1) as f64
    };
    let all = found.iter().filter(|f| matches!(f, Found::Masked(_))).count();
    Masked {
        all: all as f64 / found.len().max(1) as f64,
        unseen: share(MaskReason::Unseen),
        dark: share(MaskReason::Dark),
        ambiguous: share(MaskReason::Ambiguous),
        several: share(MaskReason::Several),
        uncertain: share(MaskReason::Uncertain),
        unexplained: share(MaskReason::Unexplained),
    }
}
