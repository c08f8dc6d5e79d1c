//! Defaults of the bench.

use super::{
    CameraConfig, FilmConfig, FilterConfig, FlashConfig, GeometryConfig, GratingConfig, PanelConfig, RigorousConfig,
    StageConfig,
};
use nacre_optics::rcwa::ALUMINIUM;

impl Default for GratingConfig {
    fn default() -> Self {
        Self { r: 1.1, zeta_deg: 45.0, ellipticity: 1.0, period_power: 1.2, rigorous: None }
    }
}

impl Default for RigorousConfig {
    fn default() -> Self {
        Self { depth_um: 0.1, metal_n: ALUMINIUM.re, metal_k: ALUMINIUM.im, max_error: 1e-3 }
    }
}

impl Default for FilmConfig {
    fn default() -> Self {
        Self { retardance_deg: 0.0, axis_deg: 20.0, front_reflection: 0.05, front_phase_deg: 0.0, index: 1.468 }
    }
}

impl Default for PanelConfig {
    fn default() -> Self {
        Self {
            disc_mm: None,
            // A common 27-inch panel.
            size_mm: [597.0, 336.0],
            polarization_deg: 0.0,
            retarder_deg: 45.0,
            retardance_deg: 90.0,
            falloff: 2.0,
            ambient: 0.002,
            gamma: 2.2,
            lag_ms: 0.0,
        }
    }
}

impl Default for FilterConfig {
    fn default() -> Self {
        Self { wavelength_nm: 550.0, band_nm: 10.0 }
    }
}

impl Default for CameraConfig {
    fn default() -> Self {
        Self {
            width: 1024,
            height: 1024,
            exposure_ms: None,
            gain: 1.0,
            well_e: 40_000.0,
            read_noise_e: 8.0,
            bits: 12,
            black_level: 64,
            sensitivity_e_ms: 2500.0,
            readout_ms: 10.0,
            queue: 4,
            lag_frames: 2,
            blur_px: 0.5,
            vignetting: 0.2,
            aperture_mm: 12.0,
            subsamples: 2,
            dark_e_s: 0.0,
            dsnu_e: 0.0,
            prnu: 0.0,
            bad_pixels: 0.0,
            response_loss: 0.0,
        }
    }
}

impl Default for StageConfig {
    fn default() -> Self {
        Self {
            speed_deg_s: 180.0,
            settle_ms: 120.0,
            backlash_deg: 0.1,
            repeatability_deg: 0.01,
            limits_deg: [-360.0, 720.0],
            extinction_ratio: 1e4,
            zero_deg: 0.0,
            clockwise: false,
            eccentricity_deg: 0.0,
            eccentricity_at_deg: 0.0,
        }
    }
}

impl Default for FlashConfig {
    fn default() -> Self {
        Self { x_mm: 300.0, y_mm: 250.0, diameter_mm: 10.0, power: 30.0, settle_ms: 1.0, max_on_s: 30.0 }
    }
}

impl Default for GeometryConfig {
    fn default() -> Self {
        Self { distance_mm: 600.0, baseline_mm: 100.0 }
    }
}
