//! The body of `POST /api/v1/reconstructions`.

use super::problem::{Answer, Problem};
use nacre_capture::plan::Method;
use nacre_image::Palette;
use nacre_polarimetry::{Align, Demosaic, Oblique, PeriodMethod, Smoothing};
use nacre_store::jobs::{LightUpload, Spec};
use serde::Deserialize;
use utoipa::ToSchema;

/// What to reconstruct.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Request {
    /// A session.
    pub session: Option<String>,
    /// Or uploaded photographs.
    pub upload: Option<String>,
    /// Of `lut`: photographs of the mirror image of a light that is no point, uploaded by themselves; the table is spread with it.
    pub light: Option<LightUpload>,
    /// `polarization` (the default), `hdr`, `lut`, `bokeh`, `spots`, `brdf`, `flash`, `foil`, `calibrate`, `map` or `render`.
    pub method: Option<Method>,
    /// Options of methods other than polarization, which has its own below. Of `hdr`: `{"response": "stated" | "linear" |
    /// "recover", "align": "auto" | "off"}`. Of `lut`, of which wavelength and scale or geometry are needed unless the photographs say
    /// them: `{"wavelength_nm": 680 | [610, 540, 460], "scale": 0.002, "geometry": {"camera_mm", "flash_mm", "baseline_mm",
    /// "pixel_um"}, "center": [x, y], "size": 1024, "extent": 1, "warp": 1, "illuminant": "D65", "observer": "1931" | "1964",
    /// "exponent": 4, "max_error": 0.01, "method": "auto" | {"rays": 1} | {"single": 0.5} | {"fixed": 5}}`. Of `bokeh`,
    /// of which `psf` is needed: `{"psf": {"sigma": 2.5}, "light": "blue", "crop": [x, y, w, h], "rotate_deg": 90, "iterations": {"auto":
    /// 500} | {"count": 30}, "scale": {"pixel": 2.5} | {"lines": {"per_mm": 50}}, "lens": {"focal_mm", "f_number", "distance_m"},
    /// "wavelength_nm": 450, "known": {"shape": "blazed", "depth_um": 0.4}, "calibration": {"gain_um", "offset"}, "slice": [x0, y0, x1,
    /// y1], "slice_width": 15}`. Of `spots`: `{"geometry": {…as in geometry.json}, "wavelength_nm":
    /// 560, "wavelength_sigma_nm": 1, "panel_mm": [520, 320], "aperture_mm": 10, "periods_um": [0.7, 4], "mirror_deg": 0.2, "palette": "cyclic" |
    /// "hsv", "no_scale_bar": false}`. Of `brdf`, for uploaded height fields: `{"pixel_um": 0.08, "range_um": 0.4, "level": false, "size": 512,
    /// "settings": {"light_deg": [30, 0], "method": "auto", "coherence_um": 65, "max_error": 0.01, "normalisation": "brdf" | "relative",
    /// "reflectance": "perfect" | "schlick=0.04" | "gold", "shadowing": false, "illuminant": "D65", "observer": "1931"}}`. Of
    /// `flash`, of which `tiles` and `size_mm`, or `reference_px`, are needed: `{"tiles": [10, 8], "size_mm": [297, 210], "reference_px": [x,
    /// y, w, h], "geometry": {…}, "corners_px": [[x, y], …], "camera_mm": 500, "light_height_mm": 200, "wavelength_nm": 560, "period_um":
    /// [1.2, 2.4], "orientation": "half" | "image", "period": "auto" | "sample" | "pixel", "palette": "cyclic" |
    /// "hsv"}`. Of `foil`: `{"geometry": {…},
    /// "period_um": [0.8, 1.5], "bins": [180, 64], "depth_um": 0.08, "light_height_mm": 300}`. Of `calibrate`, for uploaded photographs of a
    /// board: `{"board": [9, 6], "square_mm": 25, "sample_corners_px": [[x, y], …], "sample_mm": [120, 80], "wavelength_nm": 532}`; or, for
    /// photographs of the light in a mirror (or for none at all), to go on from an earlier calibration: `{"geometry": {…as in geometry.json},
    /// "highlights": [{"file": "mirror.png" | "pixel": [x, y], "height_mm": 50, "tilt_deg": [0, 0]}, …], "light_height_mm": [300, 5],
    /// "wavelength_nm": 532, "wavelength_sigma_nm": 0.5, "lamp": "A", "filter": [[nm, share], …], "response": [[nm, share], …]}`. Of `map`, for
    /// a session's maps or uploaded ones: `{"rotate_deg": 30, "resample": 2, "tile": [4, 3], "size": [w, h], "layout": "repeat" | "mirror" |
    /// "brick", "orientation_offset_deg": 5, "period": {"quadratic": [0.8, 1.6]} | {"sine_squared": [0.8, 1.6]} | {"table": [[deg, um],
    /// …]}, "scale": 1.05, "offset_um": -0.02, "clamp_um": [0.7, 2], "palette": "cyclic" | "hsv"}`. Of `render`, for an uploaded scene: `{"samples": 256, "max_error":
    /// 0.01, "wavelengths": null, "check": false, "spectral_nm": 10}`.
    #[schema(value_type = Option<Object>)]
    options: Option<serde_json::Value>,
    /// `plain` (Stokes, angle and degree of linear polarization), or a model of gratings: `auto`, `sinusoid`, `prenormalized`, `circle` or
    /// `curve`. Default: `auto` for sessions, `plain` for uploads.
    model: Option<String>,
    /// Whether what oblique incidence does to polarization is taken out: `off` (the default), or `auto`, where the photographs say
    /// where the camera stood and the points are likelier then.
    #[schema(value_type = Option<String>, example = "off")]
    oblique: Option<Oblique>,
    /// Whether photographs that are shifted against each other are moved back: `auto`, where that is worth it (the default of models of
    /// gratings), or `off` (the default of the model plain).
    #[schema(value_type = Option<String>, example = "auto")]
    align: Option<Align>,
    /// Maps of a monochrome polarization sensor in full size: how images behind each polarizer are interpolated, `bilinear` or `edge-aware`
    /// (model plain). Default: `none`, one pixel per super-pixel.
    #[schema(value_type = Option<String>, example = "none")]
    demosaic: Option<Demosaic>,
    /// Added to every orientation.
    offset_deg: Option<f64>,
    /// Smoothing of orientations in pictures and in the map `smoothed`: `none`, `light` (default), `strong` or a number of rounds.
    #[schema(value_type = Option<String>, example = "light")]
    smooth: Option<Smoothing>,
    /// Smooth the map itself and its σ as well.
    smooth_maps: Option<bool>,
    /// Also make the map `smoothed`: the smoothed orientations at full size (default: false).
    smoothed_exr: Option<bool>,
    /// Makes a map of periods: `{"from": "brightness", "range_um": [0.7, 2.0]}` (heuristic), or `{"from": "contrast",
    /// "range_um": [1.2, 3.0], "depth_um": 0.1, "metal": "aluminium", "index_above": 1, "wavelength_nm": 560}` (for an assumed
    /// surface; the last three can be left out).
    #[schema(value_type = Option<Object>)]
    period: Option<PeriodMethod>,
    /// Colours of angles in pictures: `cyclic` (the default) or `hsv`. Of `spots`, `flash` and `map` it is one of the options.
    #[schema(value_type = Option<String>, example = "cyclic")]
    palette: Option<Palette>,
    /// Leave the scale bar out of pictures (default: false). They have one where the pixel size on the sample is known.
    no_scale_bar: Option<bool>,
}

impl Request {
    /// The job that it asks for, still without a name.
    ///
    /// # Errors
    /// `bad-request` where it names no input, two of them, or something that is no id.
    pub fn spec(self) -> Answer<Spec> {
        let nothing = self.session.is_none() && self.upload.is_none() && self.method == Some(Method::Calibrate);
        if self.session.is_some() == self.upload.is_some() && !nothing {
            return Err(Problem::bad("give either a session or an upload"));
        }
        for id in self.session.iter().chain(&self.upload).chain(self.light.as_ref().map(|light| &light.upload)) {
            super::check_id(id)?;
        }
        Ok(Spec {
            id: String::new(),
            method: self.method.unwrap_or_default(),
            session: self.session,
            upload: self.upload,
            light: self.light,
            options: self.options,
            model: self.model.unwrap_or_default(),
            oblique: self.oblique.unwrap_or_default(),
            align: self.align,
            demosaic: self.demosaic.unwrap_or_default(),
            offset_deg: self.offset_deg.unwrap_or(0.0),
            smooth: self.smooth.unwrap_or_default(),
            smooth_maps: self.smooth_maps.unwrap_or(false),
            smoothed_exr: self.smoothed_exr.unwrap_or(false),
            period: self.period,
            palette: self.palette.unwrap_or_default(),
            no_scale_bar: self.no_scale_bar.unwrap_or(false),
        })
    }
}
