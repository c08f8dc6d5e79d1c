//! Properties of the pixels of a simulated sensor.

use crate::config::CameraConfig;
use crate::random::{key, normals, uniform};

/// Dark current of a hot pixel, as a share of the full well per second.
const HOT: f64 = 0.5;

/// Dark current, differences between pixels, and response of a sensor.
pub struct Sensor {
    dark_e_s: f64,
    /// Loss of response per electron.
    loss: f64,
    /// Sensitivity, dark current relative to the mean, and offset in electrons of each pixel; empty if all are equal.
    pixels: Vec<[f32; 3]>,
}

impl Sensor {
    /// The sensor of a camera; equal configurations and seeds give equal pixels.
    pub fn new(config: &CameraConfig, seed: u64) -> Self {
        let differ = config.prnu > 0.0 || config.dsnu_e > 0.0 || config.bad_pixels > 0.0;
        let count = if differ { u64::from(config.width) * u64::from(config.height) } else { 0 };
        let pixel = |i: u64| {
            let [gain, offset] = normals(key(&[seed, 0x5e45, i]));
            let regular = [1.0 + config.prnu * gain, config.dark_e_s, config.dsnu_e * offset];
            let fate = uniform(key(&[seed, 0xbad, i]));
            let [gain, dark, offset] = if fate >= config.bad_pixels {
                regular
            } else if fate < 0.5 * config.bad_pixels {
                [0.0, regular[1], regular[2]]
            } else {
                [regular[0], HOT * config.well_e, regular[2]]
            };
            [gain.max(0.0), dark, offset].map(|v| v as f32)
        };
        Self {
            dark_e_s: config.dark_e_s,
            loss: config.response_loss / config.well_e,
            pixels: (0..count).map(pixel).collect(),
        }
    }

    /// Mean number of electrons of a pixel that receives `light` electrons on average, after an exposure in seconds.
    pub fn mean(&self, pixel: usize, light: f64, exposure_s: f64) -> f64 {
        match self.pixels.get(pixel) {
            Some([gain, dark, _]) => light * f64::from(*gain) + f64::from(*dark) * exposure_s,
            None => light + self.dark_e_s * exposure_s,
        }
    }

    /// Electrons that are read for those of a pixel.
    pub fn read(&self, pixel: usize, electrons: f64) -> f64 {
        let offset = self.pixels.get(pixel).map_or(0.0, |p| f64::from(p[2]));
        electrons * (1.0 - self.loss * electrons) + offset
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_differ_as_asked() {
        let config = CameraConfig {
            width: 200,
            height: 200,
            prnu: 0.02,
            dsnu_e: 3.0,
            dark_e_s: 40.0,
            bad_pixels: 0.01,
            ..CameraConfig::default()
        };
        let sensor = Sensor::new(&config, 3);
        let deviation = |of: fn(&[f32; 3]) -> f64| {
            let good: Vec<f64> = sensor.pixels.iter().filter(|p| p[0] > 0.5 && p[1] < 50.0).map(of).collect();
            let mean = good.iter().sum::<f64>() / good.len() as f64;
            (good.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / good.len() as f64).sqrt()
        };
        assert!((deviation(|p| p[0].into()) / 0.02 - 1.0).abs() < 0.02);
        assert!((deviation(|p| p[2].into()) / 3.0 - 1.0).abs() < 0.02);
        let bad = sensor.pixels.iter().filter(|p| p[0] == 0.0 || p[1] > 50.0).count();
        assert!((300..500).contains(&bad), "{bad}");
        assert!((sensor.mean(0, 0.0, 0.5) - 20.0).abs() < 1e-6);
    }

    #[test]
    fn the_response_falls_short_at_full_well() {
        let config = CameraConfig { response_loss: 0.1, ..CameraConfig::default() };
        let sensor = Sensor::new(&config, 3);
        assert!((sensor.read(0, config.well_e) / config.well_e - 0.9).abs() < 1e-12);
    }
}
