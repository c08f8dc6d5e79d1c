//! Geometry of camera, panel and sample, from options and photographs.

use super::optics::Optics;
use super::settings::Settings;
use nacre_base::{Error, Result};
use nacre_frames::LoadedFrames;
use nacre_optics::geometry::{Camera, Geometry, Panel, Pose};

/// Geometry for the reconstruction.
pub struct Bench {
    /// Camera and panel.
    pub optics: Optics,
    /// Mapping from pixels to the sample.
    pub geometry: Geometry,
    /// Standard deviation of the wavelength in nm, if known.
    pub wavelength_sigma_nm: Option<f64>,
    /// Unverified assumptions.
    pub assumptions: Vec<String>,
}

impl Bench {
    /// From options, a geometry file and `frames.json`, in this order.
    ///
    /// # Errors
    /// `Input` for missing or invalid values.
    pub fn new(frames: &LoadedFrames, settings: &Settings) -> Result<Self> {
        let set = &frames.set;
        let mut assumptions = Vec::new();
        let geometry = match &settings.geometry {
            Some(geometry) => (**geometry).clone(),
            None => {
                let problem = "camera, sample and panel face each other as the distances of frames.json say, and the panel's right and up are the camera's";
                assumptions.push(problem.to_owned());
                parallel(frames, settings)?
            }
        };
        let place = match &settings.geometry {
            Some(_) => "the geometry".to_owned(),
            None => frames.path.display().to_string(),
        };
        let missing = |what: &str, remedy: &str| Error::input(&place, format!("does not say {what}"), remedy);
        let panel =
            geometry.panel.ok_or_else(|| missing("where the panel is", "calibrate it: `nacre calibrate geometry`"))?;
        if geometry.relative {
            let problem = "knows lengths only up to a common factor, so that periods would be relative";
            return Err(Error::input(&place, problem, "calibrate it with a target of known size"));
        }
        if let Some([w, h]) = geometry.image_px
            && [w as usize, h as usize] != [frames.info.width, frames.info.height]
        {
            let problem = format!("is for photographs of {w} × {h} pixels, but these are {}", frames.info);
            return Err(Error::input(&place, problem, "give the geometry of this camera and region of interest"));
        }
        let wavelength = settings.wavelength_nm.or(geometry.wavelength_nm).or(set.wavelength_nm);
        let nm = wavelength.ok_or_else(|| {
            missing("the wavelength", "give --wavelength-nm NM, that of light, filter and camera together")
        })?;
        if settings.wavelength_sigma_nm.or(geometry.sigma.wavelength_nm).is_none() {
            assumptions.push(format!(
                "the effective wavelength is {nm} nm; 1 nm more makes all periods {:.2} % longer",
                100.0 / nm
            ));
        }
        let axis = |i: usize| [0, 1, 2].map(|row: usize| panel.pose.rotation[row][i]);
        let from_file = [0, 1].map(|i| panel.pixel_mm[i] * f64::from(panel.size_px[i]));
        let optics = Optics {
            viewer_mm: geometry.viewer(),
            panel_axes: [axis(0), axis(1), axis(2)],
            panel_mm: panel.pose.translation_mm,
            panel_size_mm: settings.panel_mm.unwrap_or(from_file),
            wavelength_um: nm / 1000.0,
            band: set.band_nm.unwrap_or(0.0) / (8.0 * 2f64.ln()).sqrt() / nm,
            aperture_mm: settings.aperture_mm.unwrap_or(10.0),
        };
        let wavelength_sigma_nm = settings.wavelength_sigma_nm.or(geometry.sigma.wavelength_nm);
        Ok(Self { optics, geometry, wavelength_sigma_nm, assumptions })
    }
}

/// Camera and panel side by side above the sample, both parallel to it. The origin is half-way between them.
fn parallel(frames: &LoadedFrames, settings: &Settings) -> Result<Geometry> {
    let set = &frames.set;
    let remedy = "give --geometry FILE (`nacre calibrate geometry` makes one)";
    let missing = |what: &str| Error::file(&frames.path, format!("does not say {what}"), remedy);
    let distances = set.geometry.ok_or_else(|| missing("where camera and panel stand"))?;
    let pixel_mm = distances.pixel_um.ok_or_else(|| missing("geometry.pixel_um"))? / 1000.0;
    let [w, h] = settings.panel_mm.or(set.panel_mm).ok_or_else(|| {
        Error::file(&frames.path, "does not say panel_mm, the size of the panel", "add it, or give --panel-mm WxH")
    })?;
    let (d, half) = (distances.distance_mm, 0.5 * distances.baseline_mm);
    let middle = [frames.info.width, frames.info.height].map(|n| 0.5 * (n as f64 - 1.0));
    let below = distances.camera_px.unwrap_or([middle[0] - half / pixel_mm, middle[1]]);
    let camera = Camera { focal_px: [d / pixel_mm; 2], center_px: below, distortion: [0.0; 5] };
    let sample =
        Pose { rotation: [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]], translation_mm: [half, 0.0, d] };
    let rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let panel = Panel {
        pose: Pose { rotation, translation_mm: [half, 0.0, d] },
        pixel_mm: [w / 1000.0, h / 1000.0],
        size_px: [1000, 1000],
    };
    Ok(Geometry { panel: Some(panel), ..Geometry::new(camera, sample) })
}
