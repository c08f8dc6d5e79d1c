//! Reads and checks bench configurations.

use super::{BenchConfig, FaultKind, FaultyDevice};
use nacre_base::text::from_toml;

impl FaultKind {
    /// Whether a device can have this fault.
    fn befalls(self, device: FaultyDevice) -> bool {
        use FaultyDevice::{Camera, Clock, Display, Flash, Interlock, Stage};
        match self {
            Self::Silent | Self::Lost => device != Clock,
            Self::StopsShort | Self::Nonsense => device == Stage,
            Self::WrongSize | Self::Damaged => device == Camera,
            Self::OtherPattern => device == Display,
            Self::WrongState => device == Flash,
            Self::Opens => device == Interlock,
            Self::SetBack => device == Clock,
        }
    }
}

impl BenchConfig {
    /// Reads a bench from TOML.
    ///
    /// # Errors
    /// A sentence with the key, its value and the allowed range.
    pub fn from_toml(text: &str) -> Result<Self, String> {
        let config: Self = from_toml(text)?;
        config.validate()?;
        Ok(config)
    }

    /// Checks all values.
    ///
    /// # Errors
    /// A sentence with the key, its value and the allowed range.
    pub fn validate(&self) -> Result<(), String> {
        self.sample.validate()?;
        let rigorous = self.grating.rigorous.clone().unwrap_or_default();
        let (g, f, p, c, s) = (&self.grating, &self.film, &self.panel, &self.camera, &self.stage);
        for (key, value, low, high) in [
            ("grating.r", g.r, 1e-6, 1e6),
            ("grating.zeta_deg", g.zeta_deg, -360.0, 360.0),
            ("grating.ellipticity", g.ellipticity, 0.0, 1.0),
            ("grating.period_power", g.period_power, 0.0, 4.0),
            ("grating.rigorous.depth_um", rigorous.depth_um, 0.0, 2.0),
            ("grating.rigorous.metal_n", rigorous.metal_n, 0.0, 20.0),
            ("grating.rigorous.metal_k", rigorous.metal_k, 1e-3, 50.0),
            ("grating.rigorous.max_error", rigorous.max_error, 1e-6, 0.5),
            ("film.retardance_deg", f.retardance_deg, -360.0, 360.0),
            ("film.axis_deg", f.axis_deg, -360.0, 360.0),
            ("film.front_reflection", f.front_reflection, 0.0, 0.9),
            ("film.front_phase_deg", f.front_phase_deg, -360.0, 360.0),
            ("film.index", f.index, 1.0, 3.0),
            ("panel.disc_mm", p.disc_mm.unwrap_or(180.0), 0.1, 5000.0),
            ("panel.size_mm[0]", p.size_mm[0], 1.0, 1e5),
            ("panel.size_mm[1]", p.size_mm[1], 1.0, 1e5),
            ("panel.polarization_deg", p.polarization_deg, -360.0, 360.0),
            ("panel.retarder_deg", p.retarder_deg, -360.0, 360.0),
            ("panel.retardance_deg", p.retardance_deg, -360.0, 360.0),
            ("panel.falloff", p.falloff, 0.0, 20.0),
            ("panel.ambient", p.ambient, 0.0, 10.0),
            ("panel.gamma", p.gamma, 0.2, 5.0),
            ("panel.lag_ms", p.lag_ms, 0.0, 1000.0),
            ("filter.wavelength_nm", self.filter.wavelength_nm, 380.0, 780.0),
            ("filter.band_nm", self.filter.band_nm, 0.0, 200.0),
            ("camera.width", c.width.into(), 2.0, 16_384.0),
            ("camera.height", c.height.into(), 2.0, 16_384.0),
            ("camera.exposure_ms", c.exposure_ms.unwrap_or(40.0), 1e-3, 1e6),
            ("camera.gain", c.gain, 0.01, 1000.0),
            ("camera.well_e", c.well_e, 10.0, 1e7),
            ("camera.read_noise_e", c.read_noise_e, 0.0, 1e4),
            ("camera.bits", c.bits.into(), 8.0, 16.0),
            ("camera.black_level", c.black_level.into(), 0.0, f64::from(1u32 << c.bits.min(16)) - 2.0),
            ("camera.sensitivity_e_ms", c.sensitivity_e_ms, 1e-3, 1e9),
            ("camera.readout_ms", c.readout_ms, 0.0, 1e4),
            ("camera.queue", c.queue.into(), 1.0, 64.0),
            ("camera.lag_frames", c.lag_frames.into(), 0.0, 16.0),
            ("camera.blur_px", c.blur_px, 0.0, 20.0),
            ("camera.vignetting", c.vignetting, 0.0, 1.0),
            ("camera.dark_e_s", c.dark_e_s, 0.0, 1e7),
            ("camera.dsnu_e", c.dsnu_e, 0.0, 1e4),
            ("camera.prnu", c.prnu, 0.0, 0.2),
            ("camera.bad_pixels", c.bad_pixels, 0.0, 0.5),
            ("camera.response_loss", c.response_loss, 0.0, 0.5),
            ("camera.aperture_mm", c.aperture_mm, 0.0, 200.0),
            ("camera.subsamples", c.subsamples.into(), 1.0, 16.0),
            ("analyser.wedge_px", self.analyser.wedge_px, 0.0, 32.0),
            ("analyser.jitter_px", self.analyser.jitter_px, 0.0, 32.0),
            ("stage.speed_deg_s", s.speed_deg_s, 0.1, 1e5),
            ("stage.settle_ms", s.settle_ms, 0.0, 1e5),
            ("stage.backlash_deg", s.backlash_deg, -10.0, 10.0),
            ("stage.repeatability_deg", s.repeatability_deg, 0.0, 10.0),
            ("stage.extinction_ratio", s.extinction_ratio, 1.0, 1e12),
            ("stage.zero_deg", s.zero_deg, -360.0, 360.0),
            ("stage.eccentricity_deg", s.eccentricity_deg, 0.0, 10.0),
            ("stage.eccentricity_at_deg", s.eccentricity_at_deg, -360.0, 360.0),
            ("stage.limits_deg[0]", s.limits_deg[0], -36_000.0, s.limits_deg[1]),
            ("stage.limits_deg[1]", s.limits_deg[1], s.limits_deg[0], 36_000.0),
            ("flash.x_mm", self.flash.x_mm, -1e4, 1e4),
            ("flash.y_mm", self.flash.y_mm, -1e4, 1e4),
            ("flash.diameter_mm", self.flash.diameter_mm, 0.1, 1000.0),
            ("flash.power", self.flash.power, 1e-6, 1e9),
            ("flash.settle_ms", self.flash.settle_ms, 0.0, 1e5),
            ("flash.max_on_s", self.flash.max_on_s, 1e-3, 1e5),
            ("geometry.distance_mm", self.geometry.distance_mm, 10.0, 1e5),
            ("geometry.baseline_mm", self.geometry.baseline_mm, 0.0, 1e5),
        ] {
            if !(low..=high).contains(&value) {
                return Err(format!("{key} is {value}; give a number from {low} to {high}"));
            }
        }
        match self.faults.iter().position(|f| !f.kind.befalls(f.device)) {
            Some(i) => {
                let fault = &self.faults[i];
                Err(format!(
                    "faults[{i}]: the {:?} has no fault {:?}; `nacre schema bench` lists them",
                    fault.device, fault.kind
                )
                .to_lowercase())
            }
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_documented_bench_is_read() {
        let text = r#"
            seed = 7
            sample = { kind = "kinematic", size_mm = 25, depth_um = 0.1, period_um = 1.0, reflectance_variation = 0.4 }
            film = { retardance_deg = 10, axis_deg = 20, front_reflection = 0.05 }
            camera = { well_e = 40000, read_noise_e = 8, bits = 12, queue = 4, lag_frames = 2 }
            stage = { backlash_deg = 0.1, settle_ms = 120, speed_deg_s = 180 }
            geometry = { distance_mm = 600, baseline_mm = 100 }
        "#;
        let bench = BenchConfig::from_toml(text).unwrap();
        assert_eq!((bench.seed, bench.film.retardance_deg, bench.camera.width), (7, 10.0, 1024));
    }

    #[test]
    fn wrong_benches_are_refused_by_key() {
        for (text, named) in [
            ("sed = 1", "sed"),
            ("camera = { bits = 40 }", "camera.bits"),
            ("camera = { exposure_ms = nan }", "camera.exposure_ms"),
            ("film = { index = -1 }", "film.index"),
            ("sample = { kind = \"moon\" }", "moon"),
        ] {
            let message = BenchConfig::from_toml(text).unwrap_err();
            assert!(message.contains(named), "{message}");
        }
    }
}
